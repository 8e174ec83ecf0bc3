"""Structured singular value of scalar uncertainties, real and complex: bounds from both sides, and a worst case.

    1/mu(M) = the smallest max |delta_i| for which I - M diag(delta) is singular.

The upper bound is SLICOT's AB13MD (D and G scalings). The lower bound is a perturbation: a power iteration with several
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

import ctrlsys
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from amb_core.errors import RobustnessError
from amb_core.robustness.lti import Arrays, Complexes, Lti
from amb_core.robustness.mu_lower import lower_bound

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


def mu_upper(matrix: Complexes, blocks: Sequence[Block]) -> float:
    """Upper bound of mu of a matrix; RobustnessError if SLICOT fails."""
    return _upper(matrix, np.array([1 if block.real else 2 for block in blocks], dtype=np.int32))


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
    kinds = np.array([1 if block.real else 2 for block in blocks], dtype=np.int32)
    real = kinds == 1
    # SLICOT works on matrices with its own thresholds: balance them first, which changes no mu.
    curve = np.array([_upper(matrix, kinds) for matrix in system.response(frequency)])
    found = [_refine(system, kinds, frequency, curve, place) for place in _summits(curve)]
    upper, at = max(found)
    best = (0.0, at, np.zeros(0, dtype=np.complex128))
    tried = sorted({at for _, at in sorted(found, reverse=True)[:_FEW]}, key=lambda f: abs(f - at))
    for one in tried:
        best = max(best, lower_bound(system, real, one), key=lambda item: item[0])
    return MuPeak(max(upper, best[0]), best[0], at, best[1], best[2], np.asarray(frequency), curve)


def _upper(matrix: Complexes, kinds: NDArray[np.int32]) -> float:
    """Upper bound of mu by AB13MD, after Osborne's balancing, and never above the largest singular value."""
    n = len(matrix)
    if n == 1:
        value = complex(matrix[0, 0])
        return abs(value) if kinds[0] == 2 else (abs(value.real) if abs(value.imag) < 1e-14 * abs(value) else 0.0)
    balanced = balance(matrix)
    largest = float(np.linalg.norm(balanced, 2))
    if largest == 0.0:
        return 0.0
    scaled = np.asfortranarray(balanced / largest)
    bound, *_, info = ctrlsys.ab13md(scaled, np.ones(n, dtype=np.int32), kinds, "N")
    return min(largest, float(bound) * largest) if info == 0 else largest


def balance(matrix: Complexes, sweeps: int = 8) -> Complexes:
    """D M D^-1 with rows and columns of equal norm (Osborne)."""
    scaled = np.array(matrix)
    tiny = 1e-12 * float(np.abs(scaled).max(initial=0.0)) + np.finfo(float).tiny
    for _ in range(sweeps):
        for place in range(len(scaled)):
            row, column = np.delete(scaled[place], place), np.delete(scaled[:, place], place)
            ratio = np.sqrt((np.linalg.norm(column) + tiny) / (np.linalg.norm(row) + tiny))
            scaled[place] *= ratio
            scaled[:, place] /= ratio
    return scaled


def _summits(curve: Arrays) -> list[int]:
    """Places of the highest local peaks."""
    padded = np.concatenate([[-np.inf], curve, [-np.inf]])
    places = np.flatnonzero((padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:]))
    return [int(place) for place in places[np.argsort(-curve[places])][:_PEAKS]]


def _refine(
    system: Lti, kinds: NDArray[np.int32], frequency: Arrays, curve: Arrays, place: int
) -> tuple[float, float]:
    """The largest upper bound between the neighbours of a frequency, and where it is."""
    low, high = frequency[max(place - 1, 0)], frequency[min(place + 1, len(frequency) - 1)]
    found = minimize_scalar(
        lambda at: -_upper(system.response(np.array([at]))[0], kinds),
        bounds=(float(low), float(high)),
        method="bounded",
        options={"xatol": 1e-5 * (high - low), "maxiter": 40},
    )
    return max((float(-found.fun), float(found.x)), (float(curve[place]), float(frequency[place])))
