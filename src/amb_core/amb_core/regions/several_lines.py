"""Slow oscillations of more than one line, or of one between two bins: what Fisher's test of the largest bin misses.

Fisher's test compares the largest bin of a periodogram with all of them. Several lines hide each other, N equal ones
with 1 / N of the power each, and a line between two bins loses power to its neighbours. Here lines are fitted one after
the other, each at the frequency that fits best. In white noise, the share x of the power that the largest r of m bins
hold exceeds a limit with the probability (union bound; r = 1 is Fisher's test)

    P(x >= limit) <= C(m, r) P(Beta(r, m - r) >= limit).
"""

from __future__ import annotations

from functools import cache

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, comb

from amb_core.regions.slow_signal import RIDGE, least_squares, slow_line

MOST = 4  # lines that are fitted
BINS_PER_LINE = 6  # of the band for each of them, or a few lines would explain any motion
REFINEMENTS = 2  # Gauss-Newton steps of a frequency, each of half a bin at most


@cache
def critical_shares(bins: int, level: float) -> NDArray[np.float64]:
    """Shares that one, two ... lines must explain in a band of so many bins, all tests together at a level (-)."""
    most = max(min(MOST, bins // BINS_PER_LINE), 1)
    return np.array([critical_share(bins, lines, level / most) for lines in range(1, most + 1)])


@cache
def critical_share(bins: int, lines: int, level: float) -> float:
    """Share of the power of white noise that so many lines explain with a probability of `level` at most.

    Parameters
    ----------
    bins : int
        Bins of the band, more than lines.
    lines : int
        Lines that are fitted.
    level : float
        The probability (-).

    Returns
    -------
    float
        The share (-).
    """
    return 1.0 - float(betaincinv(bins - lines, lines, level / comb(bins, lines)))


@numba.njit(cache=True, error_model="numpy")
def lines_explain(
    residual: NDArray[np.float64], lowest: int, highest: int, table: NDArray[np.float64], shares: NDArray[np.float64]
) -> bool:
    """Whether one, two ... lines explain so large a share of the power between two bins.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Residual of a window (m).
    lowest, highest : int
        Bins, counted in periods per window.
    table : ndarray, shape (2, n, lines)
        From `line_table`.
    shares : ndarray, shape (lines,)
        The shares that suffice (-), see `critical_share`.

    Returns
    -------
    bool
        Whether any of the numbers of lines does.
    """
    left = residual.copy()
    _, line, _, total = slow_line(left, lowest, highest, table)
    for count in range(len(shares)):
        _remove_line(left, line)
        _, line, _, rest = slow_line(left, lowest, highest, table)
        if rest <= (1.0 - shares[count]) * total:
            return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _remove_line(residual: NDArray[np.float64], periods: float) -> None:
    """Remove a line and the parabola that it leaves, at the frequency (periods per window) near this that fits best."""
    samples = len(residual)
    columns = np.empty((6, samples))
    solution, ridge = np.empty(6), np.full(6, RIDGE * samples)
    for k in range(samples):
        time = 2.0 * k / (samples - 1) - 1.0
        columns[0, k], columns[1, k], columns[2, k] = 1.0, time, time * time
    for step in range(REFINEMENTS + 1):
        angular = 2.0 * np.pi * periods / samples
        for k in range(samples):
            columns[3, k], columns[4, k] = np.cos(angular * k), np.sin(angular * k)
        least_squares(columns[:5], residual, ridge[:5], solution[:5])
        if step == REFINEMENTS:
            break
        amplitude = np.hypot(solution[3], solution[4]) + 1e-30
        for k in range(samples):
            turned = 2.0 * np.pi * (k / samples - 0.5)
            columns[5, k] = turned * (solution[4] * columns[3, k] - solution[3] * columns[4, k]) / amplitude
        least_squares(columns, residual, ridge, solution)
        moved = solution[5] / (np.hypot(solution[3], solution[4]) + 1e-30)
        periods += min(max(moved, -0.5), 0.5)
    for k in range(samples):
        for i in range(5):
            residual[k] -= solution[i] * columns[i, k]
