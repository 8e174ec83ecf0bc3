"""The slow part of the position: what remains below some hundred hertz when the linear response is removed.

All signals are decimated to ten samples per update interval by a linear-phase filter. Over a window, the position is
fitted by least squares with

- 1, t, t^2: the bias,
- the decimated reference and its past: the response of any linear loop (a filter with `TAPS` coefficients),
- second and third harmonic of a sine, with constant and linear amplitude,
- lines that were there before the excitation, see `amb_core.regions.steady_lines`.

The residual shows a slow oscillation as a line of its periodogram. Where a harmonic of the input folds into the slow
band at the sample rate, its phase is known: lines that it explains are beating.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.special import i0

TAPS = 16  # decimated samples of the past that the linear response reaches back
HARMONICS = 3  # highest harmonic removed from the position; the first is part of the linear response
BEATS = 3  # harmonics that may beat at the same time
CONSTANT, ENVELOPE = 1, 4  # coefficients of the polynomial that a beat's amplitude and phase follow over the window
INAUDIBLE = 1e-8  # m: a decimated reference that moves less has no visible effect on the position
RIDGE = 1e-9  # relative to the power of a regressor that may resemble another
LINE_RIDGE = 3e-3  # relative to the power of a line: less than two periods in a window hardly correct it
PERIODIC = 0.9  # correlation with its own past at or above which an input repeats itself


def decimation_filter(factor: int) -> NDArray[np.float64]:
    """Coefficients of the low-pass, shape (8 factor + 1,): 80 dB at 0.84, flat to 0.2 of the decimated rate."""
    if factor <= 1:
        return np.eye(9)[4]
    cutoff, place = min(1.05 / factor, 0.99), np.arange(-4.0 * factor, 4.0 * factor + 1.0)
    window = i0(7.9 * np.sqrt(1.0 - (place / (4.0 * factor)) ** 2)) / i0(7.9)  # Kaiser's
    coefficients = cutoff * np.sinc(cutoff * place) * window
    return np.asarray(coefficients / coefficients.sum())


@numba.njit(cache=True, error_model="numpy")
def decimate(
    signal: NDArray[np.float64], coefficients: NDArray[np.float64], factor: int, decimated: NDArray[np.float64]
) -> None:
    """Filter the columns of a signal; row i of the result uses rows from i factor onwards."""
    for i in range(len(decimated)):
        for axis in range(decimated.shape[1]):
            total = 0.0
            for j in range(len(coefficients)):
                total += coefficients[j] * signal[i * factor + j, axis]
            decimated[i, axis] = total


@numba.njit(cache=True, error_model="numpy")
def least_squares(
    columns: NDArray[np.float64], values: NDArray[np.float64], ridge: NDArray[np.float64], solution: NDArray[np.float64]
) -> None:
    """Least squares by Cholesky; `columns` has one regressor per row, `ridge` is added to the squares of each."""
    count, samples = columns.shape
    normal = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            total = 0.0
            for k in range(samples):
                total += columns[i, k] * columns[j, k]
            normal[i, j] = total
        total = 0.0
        for k in range(samples):
            total += columns[i, k] * values[k]
        solution[i] = total
    for i in range(count):
        normal[i, i] += ridge[i]
    for i in range(count):
        for j in range(i + 1):
            total = normal[i, j]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            normal[i, j] = np.sqrt(max(total, 1e-14 * normal[i, i])) if i == j else total / normal[j, j]
    for i in range(count):
        for j in range(i):
            solution[i] -= normal[i, j] * solution[j]
        solution[i] /= normal[i, i]
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            solution[i] -= normal[j, i] * solution[j]
        solution[i] /= normal[i, i]


@numba.njit(cache=True, error_model="numpy")
def fit_window(
    position: NDArray[np.float64],
    reference: NDArray[np.float64],
    phase: NDArray[np.float64],
    harmonics: int,
    linear: bool,
    lines: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
    unexplained: NDArray[np.float64],
    residual: NDArray[np.float64],
) -> float:
    """Remove linear response, harmonics and steady lines from a window of n decimated samples; returns the static gain.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Decimated position (m).
    reference : ndarray, shape (n + TAPS - 1,)
        Decimated reference minus its origin (m), starting TAPS - 1 samples earlier.
    phase : ndarray, shape (n,)
        Phase of the input sine (rad).
    harmonics : int
        Highest harmonic of the sine to remove; 1 for none.
    linear : bool
        Whether the decimated reference moves enough to have a visible effect on the position.
    lines : ndarray, shape (2 lines, n)
        Cosine and sine of the phase of each steady line.
    amplitudes : ndarray, shape (2 lines,)
        Their amplitudes so far (m); receives those of the window.
    unexplained : ndarray, shape (n,)
        Receives the position without linear response, harmonics and lines: bias and slow oscillation (m).
    residual : ndarray, shape (n,)
        Receives the same without the bias (m).
    """
    samples = len(position)
    taps = TAPS if linear else 0
    others = 3 + taps + 4 * (harmonics - 1)
    count = others + len(lines)
    columns = np.empty((count, samples))
    columns[others:] = lines
    for k in range(samples):
        time = 2.0 * k / (samples - 1) - 1.0
        columns[0, k], columns[1, k], columns[2, k] = 1.0, time, time * time
        for tap in range(taps):
            columns[3 + tap, k] = reference[TAPS - 1 + k - tap]
        for harmonic in range(2, harmonics + 1):
            row = 3 + taps + 4 * (harmonic - 2)
            columns[row, k], columns[row + 1, k] = np.cos(harmonic * phase[k]), np.sin(harmonic * phase[k])
            columns[row + 2, k], columns[row + 3, k] = columns[row, k] * time, columns[row + 1, k] * time
    solution = np.empty(count)
    ridge = np.full(count, RIDGE * samples)
    ridge[:3] = 0.0  # what may be bias or response to a constant reference counts as bias
    # a sine leaves most coefficients of the filter undetermined: the ridge keeps them small
    ridge[3 : 3 + taps] = samples * INAUDIBLE**2
    ridge[others:] = samples * LINE_RIDGE
    wanted = position.copy()
    for line in range(len(lines)):
        wanted -= amplitudes[line] * lines[line]
    least_squares(columns, wanted, ridge, solution)
    solution[others:] += amplitudes
    amplitudes[:] = solution[others:]
    for k in range(samples):
        rest = position[k]
        for i in range(3, count):
            rest -= solution[i] * columns[i, k]
        unexplained[k] = rest
        residual[k] = rest - solution[0] - solution[1] * columns[1, k] - solution[2] * columns[2, k]
    return np.sum(solution[3 : 3 + taps])


def line_table(samples: int, highest: int) -> NDArray[np.float64]:
    """Cosines and sines of lines at 0, 1/2, 1, 3/2 ... `highest` bins, shape (2, samples, lines)."""
    angle = np.outer(np.arange(samples), np.pi * np.arange(2 * highest + 1) / samples)
    return np.stack([np.cos(angle), np.sin(angle)])


@numba.njit(cache=True, error_model="numpy")
def slow_line(
    residual: NDArray[np.float64], lowest: int, highest: int, table: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """Largest line of a periodogram between two bins of the window.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Residual of a window (m).
    lowest, highest : int
        Bins, counted in periods per window; the lines are half a bin apart.
    table : ndarray, shape (2, n, lines)
        From `line_table`.

    Returns
    -------
    amplitude, bin, share, power
        Amplitude of the largest line (m), its bin, its share of the power of all bins, and that power (m^2).
    """
    samples = len(residual)
    lines = 2 * highest + 1
    real, imaginary = np.zeros(lines), np.zeros(lines)
    for k in range(samples):
        for line in range(2 * lowest, lines):
            real[line] += residual[k] * table[0, k, line]
            imaginary[line] += residual[k] * table[1, k, line]
    best, best_line, total = 0.0, 0, 0.0
    for line in range(2 * lowest, lines):
        power = 2.0 * (real[line] ** 2 + imaginary[line] ** 2) / samples**2
        if power > best:
            best, best_line = power, line
        if line % 2 == 0:
            total += power
    share = min(best / total, 1.0) if total > 0.0 else 0.0
    return np.sqrt(2.0 * best), 0.5 * best_line, share, total


@numba.njit(cache=True, error_model="numpy")
def repetition(reference: NDArray[np.float64]) -> int:
    """Samples after which a reference (m) repeats itself, by its correlation; 0 if not within half of its length."""
    samples = len(reference)
    centred = reference - np.mean(reference)
    best, best_lag, apart = PERIODIC, 0, False
    for lag in range(1, samples // 2 + 1):
        early, late = centred[: samples - lag], centred[lag:]
        power = np.sqrt(np.sum(early**2) * np.sum(late**2))
        correlation = np.sum(early * late) / power if power > 0.0 else 0.0
        apart = apart or correlation < 0.5  # before that, the lag is a part of the period
        if apart and correlation > best:
            best, best_lag = correlation, lag
        elif best_lag > 0 and correlation < 0.5:
            break  # the shortest period is sufficient
    return best_lag


@numba.njit(cache=True, error_model="numpy")
def remove_beats(
    residual: NDArray[np.float64],
    phase: NDArray[np.float64],
    orders: NDArray[np.int64],
    envelope: int,
    cleaned: NDArray[np.float64],
) -> None:
    """Remove from a residual the beats of input harmonics with the sample rate, the one that explains most first.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Residual of a window (m).
    phase : ndarray, shape (n,)
        Phase of the input sine at the same steps (rad); its harmonics fold at the sample rate by themselves.
    orders : ndarray
        Harmonics that may beat.
    envelope : int
        Coefficients of the polynomial that amplitude and phase of a beat follow over the window.
    cleaned : ndarray, shape (n,)
        Receives what is left (m).
    """
    samples = len(residual)
    cleaned[:] = residual
    columns = np.empty((2 * envelope, samples))
    solution = np.empty(2 * envelope)
    ridge = np.full(2 * envelope, RIDGE * samples)
    trial = np.empty(samples)
    best_trial = np.empty(samples)
    for _ in range(min(BEATS, len(orders))):
        before = float(np.sum(cleaned**2))
        least = before
        for order in orders:
            for k in range(samples):
                time = 2.0 * k / (samples - 1) - 1.0
                columns[0, k], columns[1, k] = np.cos(order * phase[k]), np.sin(order * phase[k])
                for i in range(2, 2 * envelope):
                    columns[i, k] = columns[i - 2, k] * time
            least_squares(columns, cleaned, ridge, solution)
            left = 0.0
            for k in range(samples):
                trial[k] = cleaned[k]
                for i in range(2 * envelope):
                    trial[k] -= solution[i] * columns[i, k]
                left += trial[k] ** 2
            if left < least:
                least = left
                best_trial[:] = trial
        if least > 0.9 * before:
            return
        cleaned[:] = best_trial


@numba.njit(cache=True, error_model="numpy")
def variance_change(residual: NDArray[np.float64]) -> int:
    """Sample at which the variance most likely changes: the maximum of the Gaussian likelihood, shape (n,) -> index."""
    samples = len(residual)
    total = np.sum(residual**2)
    floor = 1e-12 * total / samples
    before, best, best_sample = 0.0, np.inf, 0
    for k in range(samples - 5):
        before += residual[k] ** 2
        if k < 4:
            continue
        first, second = k + 1, samples - k - 1
        cost = first * np.log(before / first + floor) + second * np.log((total - before) / second + floor)
        if cost < best:
            best, best_sample = cost, k + 1
    return best_sample
