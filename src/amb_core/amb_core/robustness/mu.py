"""Structured singular value of scalar uncertainties, real and complex: bounds from both sides, and a worst case.

    1/mu(M) = the smallest max |delta_i| for which I - M diag(delta) is singular.

The upper bound uses D and G scalings (`mu_upper`). The lower bound is a perturbation (`mu_lower`) for which I - M Delta
is singular to rounding. So every lower bound is attained, and the perturbation can be replayed.

Sources: M. K. H. Fan, A. L. Tits and J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
unmodeled dynamics, IEEE Transactions on Automatic Control 36 (1991); A. Packard and J. C. Doyle, The complex structured
singular value, Automatica 29 (1993); P. M. Young and J. C. Doyle, Computation of mu with real and complex
uncertainties, Conference on Decision and Control (1990).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import RobustnessError
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.robustness.mu_lower import lower_bound
from amb_core.robustness.mu_upper import top, upper_curve

_PEAKS = 4  # local peaks of the upper bound that are refined at most
_HIGH = 0.95  # of the largest: lower peaks are not refined
_ZOOM = 40  # frequencies between the neighbours of a peak, and again between those of its top
_CLOSE = 0.9999  # of the upper bound: a lower bound that is so large ends the search


@dataclass(frozen=True)
class Block:
    """One scalar perturbation.

    Attributes
    ----------
    name : str
        What is perturbed.
    real : bool
        Whether it is real; otherwise complex, which stands for unknown gain and phase.
    """

    name: str
    real: bool = False


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
    perturbation : ndarray of complex, shape (n,)
        delta of the lower bound: the largest has the magnitude 1/lower; empty if none was found.
    grid, upper_curve : ndarray, shape (f,)
        Upper bound over frequency (Hz).
    """

    upper: float
    lower: float
    frequency: float
    lower_frequency: float
    perturbation: Complexes
    grid: Arrays
    upper_curve: Arrays


def mu_peak(system: LinearSystem, blocks: Sequence[Block], frequency: Arrays) -> MuPeak:
    """Bounds of the largest mu of a system over frequency.

    Parameters
    ----------
    system : LinearSystem
        From w to z with w = diag(delta) z, stable.
    blocks : sequence of Block
        As many as the system has inputs.
    frequency : ndarray, shape (f,)
        Frequencies (Hz), ascending, at which the upper bound is computed; the highest peaks are refined between them.

    Raises
    ------
    RobustnessError
        If the system does not have one input and output for each block.
    """
    if system.d.shape != (len(blocks), len(blocks)):
        raise RobustnessError(f"{len(blocks)} perturbations need as many inputs and outputs, not {system.d.shape}")
    real = np.array([block.real for block in blocks])
    if np.all(real):  # mu of real perturbations alone may jump at frequencies at which the response is real
        frequency = np.concatenate([[0.0], frequency, [0.5 / system.sample_time]])
    curve, scalings = upper_curve(system.response(frequency), real)
    found = [_refine(system, real, frequency, curve, scalings[place], place) for place in _summits(curve)]
    upper, at = max(found)
    best = (0.0, at, np.zeros(0, dtype=np.complex128))
    tried = [at for _, at in sorted(found, reverse=True)]
    for one in tried:
        if best[0] >= _CLOSE * upper:
            break
        best = max(best, lower_bound(system, real, one, upper), key=lambda item: item[0])
    return MuPeak(max(upper, best[0]), best[0], at, best[1], best[2], np.asarray(frequency), curve)


def _summits(curve: Arrays) -> list[int]:
    """Places of the highest local peaks."""
    padded = np.concatenate([[-np.inf], curve, [-np.inf]])
    peaks = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    places = np.flatnonzero(peaks & (curve >= _HIGH * curve.max()))
    return [int(place) for place in places[np.argsort(-curve[places])][:_PEAKS]]


def _refine(
    system: LinearSystem, real: NDArray[np.bool_], frequency: Arrays, curve: Arrays, start: Arrays, place: int
) -> tuple[float, float]:
    """The largest upper bound between the neighbours of a frequency, and where it is."""
    low, high = float(frequency[max(place - 1, 0)]), float(frequency[min(place + 1, len(frequency) - 1)])
    at, width = float(frequency[place]), max(high - low, 0.0)
    for span in (width, width / _ZOOM):
        near = np.clip(at + span * np.linspace(-0.5, 0.5, _ZOOM + 1), low, high)
        largest, at, start = top(system.response(near), real, near, start)
    return max((largest, at), (float(curve[place]), float(frequency[place])))
