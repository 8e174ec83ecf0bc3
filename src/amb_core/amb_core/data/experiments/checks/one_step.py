"""One-step residuals of a loop, robust to bad samples: of the outputs, and of the law that computes the inputs.

The next position of a rotor follows almost from its last few positions and currents, and in a digital loop a current
follows exactly from the last few positions, references and currents. Both relations are fitted by least squares, on the
rows that agree; a bad sample is a row that does not. Time is linear in the samples.

Source: P. J. Rousseeuw and A. M. Leroy, Robust Regression and Outlier Detection, Wiley, 1987, chapter 5 (reweighted
least squares, median absolute deviation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.experiment import Experiment

_OUTPUT_LAGS = 4
_LAW_LAGS = (1, 3)  # of the own axis; of all axes
_ROUNDS = 5
_AGREES = 4.0  # standard deviations up to which a row counts as one that agrees
_WIDE = 10.0  # times the spread between the 5 and 95 % quantiles, beyond which a value is left out at first
_EXACT = 1e-3  # of the current's standard deviation, that an exact law leaves in the median
_PER_COLUMN = 8  # rows
_JUMP = 30.0  # times the median change, that a reference jumps by
_MEDIAN = 1.4826  # standard deviation of Gaussian noise over its median magnitude

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class OneStep:
    """Residuals of an experiment.

    Attributes
    ----------
    outputs : ndarray, shape (steps, p)
        Of the outputs; 0 where there is no past.
    laws : ndarray, shape (steps, m)
        Of the inputs; 0 where there is no past.
    noise : ndarray, shape (m,)
        Standard deviation of `laws` without bad samples.
    exact : bool
        Whether the law holds so well that one bad sample breaks it.
    lags : int
        Samples of the past that it uses.
    """

    outputs: Arrays
    laws: Arrays
    noise: Arrays
    exact: bool
    lags: int


def one_step(item: Experiment, spoilt: NDArray[np.bool_]) -> OneStep | None:
    """The residuals of an experiment, fitted without the rows that are `spoilt`; None if it has too few samples."""
    u, y, r = item.inputs, item.outputs, item.reference
    if len(u) < _PER_COLUMN * 2 * _OUTPUT_LAGS or np.ptp(u, axis=0).min() == 0.0:
        return None
    good = ~(_wide(y) | _wide(np.diff(y, axis=0, prepend=y[:1])) | spoilt)
    outputs = np.zeros_like(y)
    for axis in range(y.shape[1]):
        past = _lagged(y[:, [axis]], range(1, _OUTPUT_LAGS + 1))
        outputs[_OUTPUT_LAGS:, axis], _ = _residual(past, y[_OUTPUT_LAGS:, axis], _rows(good, _OUTPUT_LAGS))
    if u.shape[1] != y.shape[1] or r is None:
        return OneStep(outputs, np.zeros_like(u), np.full(u.shape[1], np.inf), False, 1)
    return OneStep(outputs, *_laws(u, r - y, np.diff(r, axis=0, prepend=r[:1]), good))


def _laws(u: Arrays, error: Arrays, step: Arrays, good: NDArray[np.bool_]) -> tuple[Arrays, Arrays, bool, int]:
    """The law of each axis by itself, of first order; if that is not exact the law of all axes, of third order.

    Of the reference only its changes count beside the errors, for a derivative of the positions alone. Where it jumps
    now and then only, their factor is the median over the jumps.
    """
    own, every = _LAW_LAGS
    moved, axes = u.std(axis=0), range(u.shape[1])
    jumps = jumps_of(step) & (np.median(np.abs(step), axis=0) == 0.0)  # else the other rows determine their factor
    for lags, columns in ((own, [[axis] for axis in axes]), (every, [list(axes)] * len(axes))):
        laws, noise = np.zeros_like(u), np.full(u.shape[1], np.inf)
        if len(u) < _PER_COLUMN * 3 * (lags + 1) * len(columns[0]):
            continue
        for axis in axes:
            chosen = columns[axis]
            past = [_lagged(u[:, chosen], range(1, lags + 1)), _lagged(error[:, chosen], range(lags + 1))]
            past.append(step[lags:, chosen] if lags == own else _lagged(step, range(lags + 1)))
            jumped = jumps[lags:, chosen].any(axis=1) if lags == own else np.zeros(len(u) - lags, bool)
            agrees = _rows(good, lags) & ~jumped
            laws[lags:, axis], noise[axis] = _residual(np.hstack(past), u[lags:, axis], agrees)
            if jumped.any():  # each by itself: least squares would drop them all if one fit were poor
                usable = jumped & _rows(good, lags)
                size = step[lags:, axis]
                factor = np.median(laws[lags:, axis][usable] / size[usable]) if usable.any() else 0.0
                laws[lags:, axis] -= np.where(jumped, factor * size, 0.0)
        if np.all(noise <= _EXACT * moved):
            return laws, noise, True, lags
    return laws, noise, False, lags


def jumps_of(step: Arrays) -> NDArray[np.bool_]:
    """Changes of a reference far above its usual ones."""
    return np.asarray(np.abs(step) > _JUMP * np.median(np.abs(step), axis=0))


def _lagged(signals: Arrays, lags: range) -> Arrays:
    """Rows [s[k - lag] for each lag] from the largest lag of the range onwards."""
    last = lags[-1]
    return np.hstack([signals[last - lag : len(signals) - lag] for lag in lags])


def _wide(signals: Arrays) -> NDArray[np.bool_]:
    """Samples with a value far outside of the usual range of its signal: they would outweigh all others."""
    low, middle, high = np.quantile(signals, [0.05, 0.5, 0.95], axis=0)
    return np.asarray((np.abs(signals - middle) > _WIDE * (high - low) + np.abs(middle) * 1e-12).any(axis=1))


def _rows(good: NDArray[np.bool_], lags: int) -> NDArray[np.bool_]:
    """Rows all of whose samples are good."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(good, lags + 1).all(axis=1))


def _residual(past: Arrays, target: Arrays, agrees: NDArray[np.bool_]) -> tuple[Arrays, float]:
    """Residuals of all rows by a fit to those that agree, and their standard deviation without the others."""
    centre = past.mean(axis=0)
    scale = np.maximum(past.std(axis=0), np.finfo(float).tiny)
    columns = np.column_stack([(past - centre) / scale, np.ones(len(past))])
    residual, noise = target - target.mean(), float("inf")
    for _ in range(_ROUNDS):
        if np.count_nonzero(agrees) <= 2 * columns.shape[1]:
            break
        triangle = np.asarray(np.linalg.qr(np.column_stack([columns[agrees], target[agrees]]), mode="r"))
        solution = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=1e-14)[0]
        residual = target - columns @ solution
        noise = _MEDIAN * float(np.median(np.abs(residual)))
        agrees = np.abs(residual) <= _AGREES * noise
    return residual, noise
