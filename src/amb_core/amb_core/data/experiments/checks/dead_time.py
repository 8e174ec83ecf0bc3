"""Dead time from the growth of the impulse response: what may be a slow amplifier is not called dead time.

A sampled plant responds after one sample, but little: without dead time the step response of a force on a mass behind
an amplifier of time constant tau grows as t^2 / 2 - tau t + tau^2 (1 - exp(-t / tau)), as t^3 / (6 tau) at first. Its
first sample is 5 to 20 % of the third. Whole samples of dead time shift this growth. For each number of them the
growth, with free tau, gain and slope of the gain (negative stiffness, bending modes), is fitted to the estimate and its
covariance. A dead time is found if every shorter one fits significantly worse.

Source: the impulse response of sampled systems of relative degree two and three; K. J. Astrom, P. Hagander, J. Sternby,
Zeros of sampled systems, Automatica 20 (1984) 31-38.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.data.experiments.checks.impulse_response import ImpulseResponse, impulse_response
from amb_core.data.experiments.dataset import IdentificationData

_SIGNIFICANT = 5.0  # standard deviations of a sample that responds
_LEAST_SHARE = 0.15  # of the largest of the next samples; what is less is part of the start that is fitted
_NEXT = 4  # samples
_LEAST_COUPLING = 0.1  # of the clearest output's response; what is less is no earlier response of another output
_EARLIER = 4  # dead times compared, up to the first sample that responds
_WORSE = 4.0  # chi-square by which shorter dead times must fit worse, 5 % level of one degree of freedom
_WORST = 12.0  # chi-square of the best fit beyond which the start of the response is not that of a linear bearing
_MODEL_ERROR = 0.03  # of the growth, relative to a sample of the response
_LEAST_ERROR = 0.01  # relative to the largest sample
_LARGEST_SLOPE = 0.25  # of the gain, per sample
_LAGS = np.concatenate([[0.0], np.geomspace(0.05, 10.0, 40)])  # time constants of the amplifier (samples)


def dead_times(data: IdentificationData) -> list[int] | None:
    """Samples of dead time of each input that the data prove; 0 also where they prove none; None if not checked.

    The minimum of one sample from input to output is no dead time. Direct feedthrough must be excluded before.
    """
    response = impulse_response(data)
    if response is None:
        return None
    return [_of_input(response, column) for column in range(response.mean.shape[2])]


def _of_input(response: ImpulseResponse, column: int) -> int:
    """Dead time to the output that shows the input best; no other output may respond earlier."""
    deviation = response.draws[:, :, :, column].std(axis=0)
    first = [_first_lag(response.mean[:, row, column], deviation[:, row]) for row in range(deviation.shape[1])]
    responding = [row for row, lag in enumerate(first) if lag is not None]
    if not responding:
        return 0
    clarity = np.abs(response.mean[:, :, column] / np.maximum(deviation, np.finfo(float).tiny))
    best = max(responding, key=lambda row: clarity[: (first[row] or 0) + _NEXT, row].max())
    clearest = response.mean[:, best, column]
    dead = _proven(clearest, response.draws[:, :, best, column], first[best] or 0)
    least = _LEAST_COUPLING * np.abs(clearest[: (first[best] or 0) + _NEXT]).max()
    early = np.abs(response.mean[:dead, responding, column]) > least
    early &= np.abs(response.mean[:dead, responding, column]) > _SIGNIFICANT * deviation[:dead][:, responding]
    return int(np.argmax(early.any(axis=1))) if early.any() else dead


def _first_lag(mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> int | None:
    """Index of the first sample that responds: significant, and not negligible against the next ones."""
    largest = np.array([np.abs(mean[lag : lag + _NEXT + 1]).max() for lag in range(len(mean))])
    clear = (np.abs(mean) > _SIGNIFICANT * deviation) & (np.abs(mean) > _LEAST_SHARE * largest)
    return int(np.argmax(clear)) if clear.any() else None


def _proven(mean: NDArray[np.float64], draws: NDArray[np.float64], first: int) -> int:
    """The best dead time up to the first sample that responds, less until all shorter ones fit worse."""
    shortest = max(first - _EARLIER, 0)
    window = slice(shortest, first + _NEXT)
    seen = mean[window]
    error = (_MODEL_ERROR * seen) ** 2 + (_LEAST_ERROR * np.abs(seen).max()) ** 2
    weight = linalg.cholesky(np.cov(draws[:, window], rowvar=False) + np.diag(error), lower=True)
    misfits = np.array([_misfit(seen, weight, dead) for dead in range(first - shortest + 1)])
    dead_time = int(np.argmin(misfits))
    if misfits[dead_time] > _WORST:
        return 0
    while dead_time > 0 and misfits[:dead_time].min() - misfits[dead_time] < _WORSE:
        dead_time -= 1
    return shortest + dead_time if dead_time > 0 else 0


def _misfit(seen: NDArray[np.float64], weight: NDArray[np.float64], dead: int) -> float:
    """Least chi-square of the growth after a dead time."""
    age = np.arange(1.0, len(seen) + 1.0) - dead
    least = float("inf")
    white = linalg.solve_triangular(weight, seen, lower=True)
    for kind in (_first_order, _second_order):
        for lag in _LAGS:
            growth = kind(np.maximum(age, 0.0), lag) - kind(np.maximum(age - 1.0, 0.0), lag)
            columns = linalg.solve_triangular(weight, np.column_stack([growth, growth * age]), lower=True)
            gain, slope = linalg.lstsq(columns, white)[0]
            slope = np.clip(slope, -_LARGEST_SLOPE * abs(gain), _LARGEST_SLOPE * abs(gain))
            shape = columns @ np.array([1.0, slope / gain if gain else 0.0])
            gain = shape @ white / max(float(shape @ shape), np.finfo(float).tiny)
            least = min(least, float(np.sum((white - gain * shape) ** 2)))
    return least


def _first_order(time: NDArray[np.float64], lag: float) -> NDArray[np.float64]:
    """Step response of an integrator behind a lag: plants whose output follows the force's first integral."""
    return time if lag == 0.0 else time + lag * np.expm1(-time / lag)


def _second_order(time: NDArray[np.float64], lag: float) -> NDArray[np.float64]:
    """Step response of a double integrator behind a lag."""
    return 0.5 * time**2 if lag == 0.0 else 0.5 * time**2 - lag * time - lag**2 * np.expm1(-time / lag)
