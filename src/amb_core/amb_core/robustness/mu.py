"""Structured singular value of scalar uncertainties, real and complex: bounds from both sides, and a worst case.

    1/mu(M) = the smallest max |delta_i| for which I - M diag(delta) is singular.

The upper bound uses D and G scalings (`mu_upper`). The lower bound is a perturbation: a power iteration with several
starts gives a direction, and a scale and a common phase are then solved for, so that I - M Delta is singular to
rounding. So every lower bound is attained, and the perturbation can be replayed.

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
from scipy.optimize import minimize_scalar

from amb_core.errors import RobustnessError
from amb_core.robustness.lti import Arrays, Complexes, Lti
from amb_core.robustness.mu_lower import lower_bound
from amb_core.robustness.mu_upper import upper_bound, upper_curve

_PEAKS = 4  # local peaks of the upper bound that are refined
_FEW = 6  # frequencies per refined peak at which the lower bound is sought


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


def mu_peak(system: Lti, blocks: Sequence[Block], frequency: Arrays) -> MuPeak:
    """Bounds of the largest mu of a system over frequency.

    Parameters
    ----------
    system : Lti
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
    curve = upper_curve(system.response(frequency), real)
    found = [_refine(system, real, frequency, curve, place) for place in _summits(curve)]
    upper, at = max(found)
    best = (0.0, at, np.zeros(0, dtype=np.complex128))
    tried = sorted({at for _, at in sorted(found, reverse=True)[:_FEW]}, key=lambda f: abs(f - at))
    for one in tried:
        best = max(best, lower_bound(system, real, one), key=lambda item: item[0])
    return MuPeak(max(upper, best[0]), best[0], at, best[1], best[2], np.asarray(frequency), curve)


def _summits(curve: Arrays) -> list[int]:
    """Places of the highest local peaks."""
    padded = np.concatenate([[-np.inf], curve, [-np.inf]])
    places = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    return [int(place) for place in places[np.argsort(-curve[places])][:_PEAKS]]


def _refine(system: Lti, real: NDArray[np.bool_], frequency: Arrays, curve: Arrays, place: int) -> tuple[float, float]:
    """The largest upper bound between the neighbours of a frequency, and where it is."""
    low, high = frequency[max(place - 1, 0)], frequency[min(place + 1, len(frequency) - 1)]
    found = minimize_scalar(
        lambda at: -upper_bound(system.response(np.array([at]))[0], real),
        bounds=(float(low), float(high)),
        method="bounded",
        options={"xatol": 1e-4 * (high - low), "maxiter": 25},
    )
    again = upper_bound(system.response(frequency[place : place + 1])[0], real)  # the curve is coarser
    return max((float(-found.fun), float(found.x)), (min(again, float(curve[place])), float(frequency[place])))
