"""Structured singular value of uncertainties, real and complex: bounds from both sides, and a worst case.

    1/mu(M) = the smallest max |delta_i| for which I - M diag(delta) is singular.

The upper bound uses D and G scalings (`mu_upper`). The lower bound is a perturbation (`mu_lower`) for which I - M Delta
is singular to rounding. So every lower bound is attained, and the perturbation of scalars can be replayed. Full complex
blocks and repeated real numbers have bounds of their own (`mu_blocks`).

Sources: M. K. H. Fan, A. L. Tits and J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
unmodeled dynamics, IEEE Transactions on Automatic Control 36 (1991); A. Packard and J. C. Doyle, The complex structured
singular value, Automatica 29 (1993); P. M. Young and J. C. Doyle, Computation of mu with real and complex
uncertainties, Conference on Decision and Control (1990).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from amb_core.ground.errors import RobustnessError
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.robustness.mu_blocks import Blocks, lower_of_blocks, upper_of_blocks
from amb_core.robustness.mu_lower import lower_bound
from amb_core.robustness.mu_upper import scalings as searched_scalings
from amb_core.robustness.mu_upper import top, upper_curve

_PEAKS = 4  # local peaks of the upper bound that are refined at most
_HIGH = 0.95  # of the largest: lower peaks are not refined
_ZOOM = 40  # frequencies between the neighbours of a peak, and again between those of its top
_APART = 0.02  # relative: of bounds that leave so much open more frequencies are tried
_ELSEWHERE = 24  # of these at most
_CLOSE = 0.9999  # of the upper bound: a lower bound that is so large ends the search


@dataclass(frozen=True)
class Block:
    """One perturbation.

    Attributes
    ----------
    name : str
        What is perturbed.
    real : bool
        Whether it is real; otherwise complex, which stands for unknown gain and phase.
    size : int
        1 for a number. A larger real block is a number that is repeated so often on the diagonal; a larger complex one
        is a full matrix, measured by its largest singular value.
    """

    name: str
    real: bool = False
    size: int = 1


@dataclass(frozen=True, eq=False)
class MuPeak:
    """Bounds of the largest mu over frequency.

    Attributes
    ----------
    upper, lower : float
        Bounds of the largest value.
    frequency : float
        Of the upper bound's peak (Hz).
    lower_frequency : float
        At which the perturbation puts a pole on the unit circle (Hz).
    perturbation : ndarray of complex, shape (n,), or (n, n) with blocks of size 2 or more
        Delta of the lower bound, as its diagonal or whole: its size is 1/lower; empty if none was found.
    grid, upper_curve : ndarray, shape (f,)
        Upper bound at the given frequencies (Hz).
    """

    upper: float
    lower: float
    frequency: float
    lower_frequency: float
    perturbation: Complexes
    grid: Arrays
    upper_curve: Arrays

    @property
    def gap(self) -> float:
        """How much larger the upper bound is than the lower one, relative; infinite if no perturbation was found."""
        return self.upper / self.lower - 1.0 if self.lower else math.inf if self.upper else 0.0


def mu_peak(system: LinearSystem, blocks: Sequence[Block], frequency: Arrays) -> MuPeak:
    """Bounds of the largest mu of a system over frequency.

    Parameters
    ----------
    system : LinearSystem
        From w to z with w = Delta z, stable.
    blocks : sequence of Block
        Along the diagonal of Delta; together of as many rows as the system has inputs.
    frequency : ndarray, shape (f,)
        Frequencies (Hz), ascending, at which the upper bound is computed, as it is at 0 Hz and at half the sample rate;
        the highest peaks are refined between them.

    Returns
    -------
    MuPeak
        Lower and upper bound, with the frequency of the peak.

    Raises
    ------
    RobustnessError
        If the system does not have one input and output for each block.
    """
    size = sum(block.size for block in blocks)
    if system.d.shape != (size, size) or any(block.size < 1 for block in blocks):
        raise RobustnessError(f"perturbations of {size} rows need as many inputs and outputs, not {system.d.shape}")
    # A slow loop may have its peak at rest, and mu of real perturbations alone may jump where the response is real.
    ends = 0.0, 0.5 / system.sample_time
    every = np.unique(np.concatenate([frequency, ends]))
    real = np.array([block.real for block in blocks])
    if size > len(blocks):
        peak = _peak_of_blocks(system, Blocks([block.size for block in blocks], list(real)), every)
    else:
        peak = _peak_of_numbers(system, real, every)
    return replace(peak, grid=np.asarray(frequency), upper_curve=peak.upper_curve[np.searchsorted(every, frequency)])


def _peak_of_numbers(system: LinearSystem, real: NDArray[np.bool_], frequency: Arrays) -> MuPeak:
    """The largest mu over frequencies and between them, with perturbations that are numbers."""
    curve, scalings = upper_curve(system.response(frequency), real)
    peaks = [_refine(system, real, frequency, curve, scalings[place], place) for place in _summits(curve)]
    peaks.sort(key=lambda item: item[0], reverse=True)
    upper, at, _ = peaks[0]
    best = (0.0, at, np.zeros(0, dtype=np.complex128))
    for _, one, scaling in peaks:
        if best[0] >= _CLOSE * upper:
            break
        best = max(best, lower_bound(system, real, one, upper, scaling=scaling), key=lambda item: item[0])
    if upper > (1.0 + _APART) * best[0]:  # mu may peak elsewhere than its bound
        higher = np.flatnonzero(curve > (1.0 + _APART) * best[0])
        for place in higher[np.linspace(0, len(higher) - 1, min(_ELSEWHERE, len(higher))).round().astype(int)]:
            start = searched_scalings(system.response(frequency[place : place + 1])[0], real, scalings[place])[1]
            found_there = lower_bound(system, real, float(frequency[place]), upper, scaling=start, programs=0)
            best = max(best, found_there, key=lambda item: item[0])
    return MuPeak(max(upper, best[0]), best[0], at, best[1], best[2], np.asarray(frequency), curve)


def _peak_of_blocks(system: LinearSystem, blocks: Blocks, frequency: Arrays) -> MuPeak:
    """The same with full complex blocks and repeated real numbers."""

    def upper(at: float) -> tuple[float, Complexes, Complexes]:
        return upper_of_blocks(system.response(np.array([at]))[0], blocks)

    curve = np.array([upper(float(at))[0] for at in frequency])
    bounds = []
    for place in _summits(curve):
        ends = frequency[max(place - 1, 0)], frequency[min(place + 1, len(frequency) - 1)]
        at = minimize_scalar(lambda one: -upper(float(one))[0], bounds=ends, method="bounded").x
        bounds += [(upper(float(one)), float(one)) for one in (at, frequency[place])]
    bounds.sort(key=lambda item: item[0][0], reverse=True)
    best: tuple[float, float, Complexes] = (0.0, bounds[0][1], np.zeros(0, dtype=np.complex128))
    for bound, at in bounds:
        value, delta = lower_of_blocks(system.response(np.array([at]))[0], blocks, bound)
        if value > best[0]:
            best = value, at, delta
    highest = max(bounds[0][0][0], best[0])
    return MuPeak(highest, best[0], bounds[0][1], best[1], best[2], np.asarray(frequency), curve)


def _summits(curve: Arrays) -> list[int]:
    """Places of the highest local peaks."""
    padded = np.concatenate([[-np.inf], curve, [-np.inf]])
    peaks = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    places = np.flatnonzero(peaks & (curve >= _HIGH * curve.max()))
    return [int(place) for place in places[np.argsort(-curve[places])][:_PEAKS]]


def _refine(
    system: LinearSystem, real: NDArray[np.bool_], frequency: Arrays, curve: Arrays, start: Arrays, place: int
) -> tuple[float, float, Arrays]:
    """The largest upper bound between the neighbours of a frequency, where it is, and its scalings."""
    low, high = float(frequency[max(place - 1, 0)]), float(frequency[min(place + 1, len(frequency) - 1)])
    at, width, own = float(frequency[place]), max(high - low, 0.0), start
    for span in (width, width / _ZOOM):
        near = np.clip(at + span * np.linspace(-0.5, 0.5, _ZOOM + 1), low, high)
        largest, at, start = top(system.response(near), real, near, start)
    if largest >= curve[place]:
        return largest, at, start
    return float(curve[place]), float(frequency[place]), own
