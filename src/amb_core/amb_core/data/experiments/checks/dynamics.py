"""Checks of how inputs and outputs depend on each other: feedback, delay.

Both use a high-order ARX model, y[k] from the last L values of inputs and outputs: with L long enough its residuals
are the innovations, in open loop and in closed loop. Dead time has a module of its own (`dead_time`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from amb_core.data.experiments.checks.dead_time import dead_times
from amb_core.data.experiments.checks.lagged import pieces, rows_of, triangle_of
from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData

LEVEL = 0.01  # probability of a false statement of each check
_LONGEST_LAG = 20
_ROWS_PER_COLUMN = 8
_LONG_DEAD_TIME = 2  # samples; from here on a model that has to include it is clearly worse
_NO_RESIDUE = 1e-12  # variance relative to the signal's, below which the remainder is rounding


def check_feedback(data: IdentificationData) -> Finding:
    """Whether outputs act on the inputs: whether later inputs help to explain an output.

    Without feedback the innovations of an output are independent of all inputs, future ones included. With feedback,
    inputs respond to innovations. Later inputs then correlate with the part of an output that the past and the present
    input do not explain. If they do not, the present input alone may correlate with it. That is feedback within the
    sample or direct feedthrough, which no data can distinguish; with a reference, hence a controller, it counts as
    feedback. F tests at 1 % for all pairs of output and input together.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.

    Returns
    -------
    Finding
        Whether there is feedback.

    References
    ----------
    C. A. Sims, Money, income, and causality, Am. Econ. Rev. 62 (1972); P. E. Caines and C. W. Chan, Feedback between
    stationary stochastic processes, IEEE Trans. Autom. Control 20 (1975).
    """
    lags = _lags(data)
    if lags is None:
        return Finding("feedback", Severity.INFO, "not checked: too few samples")
    lead = (lags + 1) // 2
    m, p = len(data.input_names), len(data.output_names)
    factor, rows = _factor(data, lags, lead)
    later, past = np.arange(m * lead), np.arange(m * (lead + 1), factor.shape[1] - p)
    present = np.arange(m * lead, m * (lead + 1))
    shares = _explained(data, factor, rows, np.concatenate([present, past]), later)
    if not shares and all(item.reference is not None for item in data.experiments):
        shares = _explained(data, factor, rows, past, present)
    if not shares:
        return Finding(
            "feedback", Severity.INFO, "none found (1 % level); it cannot be found if noise is far below the excitation"
        )
    return Finding(
        "feedback",
        Severity.INFO,
        f"inputs respond to the outputs (they explain up to {100.0 * max(shares.values()):.3g} % of the innovations)",
        ", ".join(shares),
        "use ssarx or pem; n4sid, moesp and cva are biased on such data",
    )


def check_delay(data: IdentificationData, feedback: bool = True, feedthrough: bool = False) -> Finding:
    """Dead time of each input and direct feedthrough; samples after which a response is significant.

    A response is significant from the largest d for which the coefficients of all inputs less than d samples old can be
    zero (F test at 1 % for all lags together, ARX model). Noise may hide an earlier response, so this is no dead time:
    `dead_times` finds that in the growth of the response. With feedback a controller may respond within the sample, and
    this test cannot detect an output that does: then one sample is the minimum.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    feedback : bool, optional
        Whether a controller acts on the inputs.
    feedthrough : bool, optional
        Whether the model is to have direct feedthrough.

    Returns
    -------
    Finding
        Delay of each pair of output and input.

    References
    ----------
    L. Ljung, System Identification, 2nd edition, 1999, sections 16.4 and II.3.
    """
    lags = _lags(data)
    if lags is None:
        return Finding("delay", Severity.INFO, "not checked: too few samples")
    m, p = len(data.input_names), len(data.output_names)
    first = 1 if feedback else 0
    factor, rows = _factor(data, lags)
    delays = [_delays(factor, rows, column, m, p, lags, first) for column in range(m)]
    nearest = [min(of_input) for of_input in delays]
    what = f"samples until a response is significant: {_table(data, delays, lags)}"
    silent = [name for name, delay in zip(data.input_names, nearest, strict=True) if delay > lags]
    if silent:
        return Finding(
            "delay",
            Severity.WARNING,
            f"no output responds to it within {lags} samples",
            ", ".join(silent),
            "excite it more, or leave it out of --inputs (in Python: select)",
        )
    if 0 in nearest and feedthrough:
        return Finding("delay", Severity.INFO, f"{what}; the model has direct feedthrough")
    if 0 in nearest:
        advance = [-1 if delay == 0 else 0 for delay in nearest]
        return Finding(
            "delay",
            Severity.WARNING,
            what,
            advice="models have no direct feedthrough (D = 0) by default: unless a controller responds within the "
            f"sample, identify with --feedthrough (in Python also: advance_inputs(data, {advance}))",
        )
    return _dead_time(data, what)


def _dead_time(data: IdentificationData, what: str) -> Finding:
    dead = dead_times(data)
    if dead is None:
        return Finding("delay", Severity.INFO, f"{what}; dead time not checked: too few samples")
    if not any(dead):
        return Finding("delay", Severity.INFO, f"{what}; no dead time found")
    table = ", ".join(f"{name} {samples}" for name, samples in zip(data.input_names, dead, strict=True))
    return Finding(
        "delay",
        Severity.WARNING if max(dead) >= _LONG_DEAD_TIME else Severity.INFO,
        f"{what}; samples of dead time: {table}",
        advice=f"dead time costs a state for each sample (in Python advance_inputs(data, {dead}) removes it)",
    )


def _table(data: IdentificationData, delays: list[list[int]], lags: int) -> str:
    return "; ".join(
        f"{name} to "
        + ", ".join(
            f"{output} {'none' if delay > lags else delay}"
            for output, delay in zip(data.output_names, of_input, strict=True)
        )
        for name, of_input in zip(data.input_names, delays, strict=True)
    )


def _lags(data: IdentificationData) -> int | None:
    """Length of the ARX model; None if the samples do not suffice for two lags."""
    width = len(data.input_names) + len(data.output_names)
    longest = max(item.steps for item in data.experiments)
    lags = min(_LONGEST_LAG, longest // (_ROWS_PER_COLUMN * width + 1))
    return lags if lags >= 2 else None


def _factor(data: IdentificationData, lags: int, lead: int = 0) -> tuple[NDArray[np.float64], int]:
    """Triangular factor of rows [u[k+lead] ... u[k] ... u[k-lags]  y[k-1] ... y[k-lags]  y[k]], and their number."""
    p = len(data.output_names)

    def matrix(u: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        inputs = rows_of(u, range(lags + lead + 1))
        outputs = rows_of(y, range(lags + 1))[: len(inputs)]
        return np.hstack([inputs, outputs[:, p:], outputs[:, :p]])

    return triangle_of(matrix(u, y) for u, y in pieces(data, lags + lead))


def _explained(
    data: IdentificationData,
    factor: NDArray[np.float64],
    rows: int,
    known: NDArray[np.intp],
    tested: NDArray[np.intp],
) -> dict[str, float]:
    """Pairs `output to input` for which the tested columns of the input help, and the share that they explain."""
    m, p = len(data.input_names), len(data.output_names)
    shares = {}
    for column, name in enumerate(data.input_names):
        own = tested[column::m]
        freedom = rows - len(known) - len(own)
        for row, output in enumerate(data.output_names):
            added, residual = _added(factor, known, own, factor.shape[1] - p + row)
            gain = float(added @ added)
            ratio = gain / len(own) / max(residual / freedom, _NO_RESIDUE)
            if special.fdtrc(len(own), freedom, ratio) < LEVEL / (m * p):
                shares[f"{output} to {name}"] = gain / (gain + residual)
    return shares


def _added(
    factor: NDArray[np.float64], known: NDArray[np.intp], own: NDArray[np.intp], target: int
) -> tuple[NDArray[np.float64], float]:
    """What regressors add to the fit of a target, in order, and the remaining sum of squares.

    The sum of squares of the first numbers is what the first columns of `own` remove from the residual of the columns
    `known`.
    """
    turned = linalg.qr(factor[:, [*known, *own, target]], mode="r", check_finite=False)[0]
    count = len(known) + len(own)
    return turned[len(known) : count, -1], float(np.sum(turned[count:, -1] ** 2))


def _delays(factor: NDArray[np.float64], rows: int, column: int, m: int, p: int, lags: int, first: int) -> list[int]:
    """Samples until the response of each output to one input is significant, `lags` + 1 if it never is.

    The values of this input are sorted from the oldest to the most recent, so the last numbers are the contribution of
    the most recent values.
    """
    inputs, outputs = np.arange(m * first, m * (lags + 1)), m * (lags + 1) + np.arange(p * lags)
    own = inputs[column::m][::-1]
    known = np.concatenate([outputs, np.setdiff1d(inputs, own)])
    freedom = rows - len(known) - len(own)
    numbers = np.arange(1, len(own) + 1)
    delays = []
    for target in range(factor.shape[1] - p, factor.shape[1]):
        added, residual = _added(factor, known, own, target)
        variance = max(residual / freedom, _NO_RESIDUE)
        ratio = np.cumsum(added[::-1] ** 2) / numbers / variance
        significant = special.fdtrc(numbers, freedom, ratio) < LEVEL / (m * p * len(own))
        delays.append(first + int(np.argmax(significant)) if significant.any() else lags + 1)
    return delays
