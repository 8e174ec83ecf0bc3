"""Subspace identification (N4SID) of a plant that may be unstable, from data of the closed loop.

SLICOT's IB01AD and IB01BD estimate the order-n state space and the noise covariances; the Kalman gain comes from
scipy's Riccati solver, because IB01BD's own (jobck 'K') writes outside its workspace from order 8 on. IB01BD returns a
feedthrough D that the plant does not have (the position answers after the current reference), so B, x[0] are estimated
anew with D = 0, by least squares on the one-step prediction error (see `predictor`).

Known limit: projections that assume inputs independent of past noise are biased on closed-loop data. The bias
falls with the ratio of noise to excitation; below 0.1 um of noise at 50 um of excitation it does not matter.

Sources: P. Van Overschee and B. De Moor, Subspace Identification for Linear Systems, Kluwer, 1996; V. Sima,
D. M. Sima and S. Van Huffel, High-performance numerical algorithms and software for subspace-based linear multivariable
system identification, J. Comput. Appl. Math. 170 (2004).
"""

from __future__ import annotations

import ctrlsys
import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import threadpool_limits

from amb_core.errors import IdentificationError
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.predictor import fit_input_matrix, innovations

HIGHEST_ORDER = 30
HORIZONS = (1.2, 1.5, 2.0, 3.0, 5.0)  # block rows in multiples of the order
_MOST_BLOCK_ROWS = 200
_MOST_ELEMENTS = 30_000_000  # of the data matrix, which SLICOT holds where it must turn from Cholesky to QR: 240 MB
_SMALLEST_MAGNITUDE = 1e-30  # far from the limits of floating point, so that variances are neither zero nor infinite
_SMALLEST_EIGENVALUE = 1e-12  # of the correlation matrix of all signals
_LEAST_BLOCK_ROWS = 8


def n4sid(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int = 10,
    block_rows: int | None = None,
    source: str = "",
) -> StateSpaceModel:
    """Identify a state-space model of a given order; means are removed from the data and kept as its offsets.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, 2), (steps, 2)
        Control current references (A) and positions (m).
    sample_time : float
        Sample time of the data (s).
    order : int
        Number of states n.
    block_rows : int, optional
        Block rows of the Hankel matrices (past and future horizon), more than the order; twice the order by default.
    source : str
        Where the data come from, kept in the model.

    Raises
    ------
    IdentificationError
        If the order does not suit the data or the data determine no model; one line that says why.
    """
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    outputs = np.ascontiguousarray(outputs, dtype=np.float64)
    if block_rows is None:
        block_rows = _horizon(order, 2.0)
    _check_size(order, block_rows, len(inputs))
    _check_samples("input", inputs)
    _check_samples("output", outputs)
    input_offset, output_offset = inputs.mean(axis=0), outputs.mean(axis=0)
    input_scale, output_scale = inputs.std(axis=0), outputs.std(axis=0)
    u, y = (inputs - input_offset) / input_scale, (outputs - output_offset) / output_scale
    _check_independence(np.hstack([u, y]))
    # The matrices are small: more BLAS threads only cost time, and take cores from the control loop.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            a, c, k = _predictor_matrices(u, y, order, block_rows)
            b, initial_state = fit_input_matrix(a, c, k, u, y)
            errors = innovations(a, b, c, k, initial_state, u, y)
        except (linalg.LinAlgError, ValueError) as problem:
            reason = " ".join(str(problem).split())
            raise IdentificationError(f"no model of order {order} from {len(inputs)} samples: {reason}") from None
    return StateSpaceModel(
        a=a,
        b=b / input_scale,
        c=c * output_scale[:, np.newaxis],
        d=np.zeros((2, 2)),
        k=k / output_scale,
        innovation_covariance=errors.T @ errors / len(errors) * np.outer(output_scale, output_scale),
        input_offset=input_offset,
        output_offset=output_offset,
        initial_state=initial_state,
        sample_time=sample_time,
        method="n4sid",
        source=source,
        samples=len(inputs),
    )


def n4sid_horizons(
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int = 10,
    source: str = "",
) -> list[StateSpaceModel]:
    """Models of one order from horizons of different length, at least one; arguments and errors are those of `n4sid`.

    A long horizon averages noise, a short one lets an operating point drift. Which is better the data must show. Of
    long data only short horizons are tried, to bound time and memory.
    """
    models: list[StateSpaceModel] = []
    reasons: list[IdentificationError] = []
    shortest, *longer = sorted({_horizon(order, ratio) for ratio in HORIZONS})
    affordable = [block_rows for block_rows in longer if 8 * block_rows * len(inputs) <= _MOST_ELEMENTS]
    for block_rows in [shortest, *affordable]:
        try:
            models.append(n4sid(inputs, outputs, sample_time, order, block_rows, source))
        except IdentificationError as reason:
            reasons.append(reason)
    if not models:
        raise reasons[0]
    return models


def samples_needed(block_rows: int) -> int:
    """Fewest samples for which the Hankel matrices of two inputs and two outputs have as many columns as rows."""
    return 10 * block_rows - 1


def _horizon(order: int, ratio: float) -> int:
    return max(_LEAST_BLOCK_ROWS, round(ratio * order))


def _check_size(order: int, block_rows: int, samples: int) -> None:
    if not 1 <= order <= HIGHEST_ORDER:
        raise IdentificationError(f"order {order} is not allowed; allowed: 1 to {HIGHEST_ORDER}")
    if not order < block_rows <= _MOST_BLOCK_ROWS:
        raise IdentificationError(
            f"block_rows {block_rows} is not allowed; allowed: {order + 1} to {_MOST_BLOCK_ROWS} for order {order}"
        )
    if samples < samples_needed(block_rows):
        raise IdentificationError(
            f"{samples} samples are too few for order {order}; at least {samples_needed(block_rows)} are needed"
        )


def _check_samples(kind: str, samples: NDArray[np.float64]) -> None:
    finite = np.isfinite(samples).all(axis=1)
    if not finite.all():
        step = int(np.argmin(finite))
        raise IdentificationError(f"{kind} is not finite at sample {step}: {samples[step].tolist()}")
    for axis, name in enumerate("xy"):
        if np.ptp(samples[:, axis]) == 0.0:
            raise IdentificationError(
                f"{kind} of axis {name} is constant at {samples[0, axis]:g}; both axes must move to be identified"
            )
        largest = float(np.max(np.abs(samples[:, axis])))
        if not _SMALLEST_MAGNITUDE < largest < 1.0 / _SMALLEST_MAGNITUDE:
            raise IdentificationError(
                f"{kind} of axis {name} has a largest magnitude of {largest:g} (A or m); "
                f"allowed: {_SMALLEST_MAGNITUDE:g} to {1.0 / _SMALLEST_MAGNITUDE:g}"
            )


def _check_independence(signals: NDArray[np.float64]) -> None:
    """Refuse signals (inputs, then outputs, each with mean 0 and variance 1) of which one follows from the others."""
    eigenvalues = np.linalg.eigvalsh(signals.T @ signals / len(signals))
    if eigenvalues[0] < _SMALLEST_EIGENVALUE:
        raise IdentificationError(
            "inputs and outputs of the two axes are not independent (one is a sum of multiples of the others); "
            "excite the axes independently"
        )


def _predictor_matrices(
    inputs: NDArray[np.float64], outputs: NDArray[np.float64], order: int, block_rows: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A, C and the Kalman gain K of scaled data."""
    m, p = inputs.shape[1], outputs.shape[1]
    u, y = np.asfortranarray(inputs), np.asfortranarray(outputs)
    # Correlation matrix and Cholesky factor ('C'), 40 times faster than QR; where that fails SLICOT turns to QR itself.
    _, triangle, _, _, info = ctrlsys.ib01ad("N", "C", "N", "O", "N", "N", block_rows, m, p, u, y, 0.0, 0.0)
    if info != 0:
        raise IdentificationError(f"the data matrix cannot be compressed (SLICOT IB01AD, info {info})")
    # A and C only: with job 'A', B and D too, ctrlsys gives SLICOT too small a workspace for long horizons.
    a, c, _, _, q, r, s, _, _, info = ctrlsys.ib01bd("N", "C", "C", block_rows, order, m, p, len(u), triangle, 0.0)
    if info != 0:
        raise IdentificationError(f"the system matrices cannot be estimated (SLICOT IB01BD, info {info})")
    try:
        variance = linalg.solve_discrete_are(a.T, c.T, q, r, s=s)
    except (linalg.LinAlgError, ValueError):
        raise IdentificationError(
            f"the Kalman gain of order {order} does not exist; lower the order or excite both axes more"
        ) from None
    k = np.linalg.solve(c @ variance @ c.T + r, (a @ variance @ c.T + s).T).T
    radius = float(np.max(np.abs(np.linalg.eigvals(a - k @ c))))
    if not radius < 1.0:
        raise IdentificationError(f"the predictor of order {order} is unstable (spectral radius {radius:.6g})")
    return a, c, k
