"""Slow oscillations below the band of the short window: windows of 0.3, 0.6, 1.2 ... 9 s, each for one octave.

The position without linear response, harmonics and steady lines is averaged over blocks, so that every window has
`BLOCKS` of them. A bias that drifts, with one kink, is removed: a cubic in time and the ramp max(0, t - t_k) that fits
best. The largest line between 3 and 6.5 periods a window must pass Fisher's test against the lines up to `REFERENCE`
periods, and have the amplitude that counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.regions.evidence import LineEvidence
from amb_core.regions.judged import OtherCause
from amb_core.regions.slow_signal import INAUDIBLE, least_squares, line_table, variance_change

LOWEST = 0.5  # Hz, of an oscillation: slower ones cannot be distinguished from drift within seconds
BLOCKS = 96  # per window
FIRST, LAST = 3.0, 6.5  # periods a window of the lines that a window is searched for
REFERENCE = 24  # periods a window of the highest line of the noise
KINKS = 16  # positions of a kink that are tried
EVALUATIONS = 12  # per window
BEATING = 0.25  # share of a window in which a harmonic may fold into its band
TABLE = line_table(BLOCKS, REFERENCE)


@numba.njit(cache=True, error_model="numpy")
def remove_drift(blocks: NDArray[np.float64], residual: NDArray[np.float64]) -> None:
    """Remove a cubic in time and the ramp that fits best; shapes (n,)."""
    samples = len(blocks)
    columns = np.empty((5, samples))
    for k in range(samples):
        time = 2.0 * k / (samples - 1) - 1.0
        columns[0, k], columns[1, k] = 1.0, time
        columns[2, k], columns[3, k] = 1.5 * time**2 - 0.5, 2.5 * time**3 - 1.5 * time
    solution, ridge, trial = np.empty(5), np.zeros(5), np.empty(samples)
    least = np.inf
    for kink in range(KINKS):
        start = (kink + 1.0) / (KINKS + 1.0) * samples
        for k in range(samples):
            columns[4, k] = max(k - start, 0.0) / samples
        least_squares(columns, blocks, ridge, solution)
        left = 0.0
        for k in range(samples):
            trial[k] = blocks[k]
            for i in range(5):
                trial[k] -= solution[i] * columns[i, k]
            left += trial[k] ** 2
        if left < least:
            least = left
            residual[:] = trial


@numba.njit(cache=True, error_model="numpy")
def largest_line(
    residual: NDArray[np.float64], first: float, last: float, reference: int, table: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Amplitude (m) and periods per window of the largest line in a band, and its share of the power up to `reference`.

    `table` is from `line_table`; lines are half a period per window apart, those of the power one.
    """
    samples = len(residual)
    best, best_line, total = 0.0, 0, 0.0
    for line in range(int(2 * first), 2 * reference + 1):
        real, imaginary = 0.0, 0.0
        for k in range(samples):
            real += residual[k] * table[0, k, line]
            imaginary += residual[k] * table[1, k, line]
        power = 2.0 * (real * real + imaginary * imaginary) / samples**2
        if power > best and 0.5 * line <= last:
            best, best_line = power, line
        if line % 2 == 0:
            total += power
    return np.sqrt(2.0 * best), 0.5 * best_line, min(best / total, 1.0) if total > 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def push(
    samples: NDArray[np.float64],
    lengths: NDArray[np.int64],
    sums: NDArray[np.float64],
    filled: NDArray[np.int64],
    blocks: NDArray[np.float64],
    known: NDArray[np.int64],
    due: NDArray[np.int64],
) -> None:
    """Add samples to all windows.

    Parameters
    ----------
    samples : ndarray, shape (n, 3)
        Position, reference (m) and frequency of the input (Hz).
    lengths : ndarray, shape (windows,)
        Samples per block.
    sums, filled : ndarray, shapes (windows, 3) and (windows,)
        The block in progress.
    blocks : ndarray, shape (windows, BLOCKS, 3)
        Means of the latest blocks, the newest last.
    known : ndarray, shape (windows,)
        Blocks so far.
    due : ndarray, shape (windows,)
        Receives the number of samples since the block with which a window became due for a test; -1 if it did not.
    """
    due[:] = -1
    for k in range(len(samples)):
        for window in range(len(lengths)):
            sums[window] += samples[k]
            filled[window] += 1
            if filled[window] == lengths[window]:
                blocks[window, :-1] = blocks[window, 1:].copy()
                blocks[window, -1] = sums[window] / lengths[window]
                sums[window] = 0.0
                filled[window] = 0
                known[window] += 1
                if known[window] >= BLOCKS and known[window] % (BLOCKS // EVALUATIONS) == 0:
                    due[window] = len(samples) - 1 - k


@dataclass(frozen=True)
class SlowLine:
    """What a window shows: a line's amplitude (m), frequency (Hz), its age in decimated samples, and Fisher's test."""

    amplitude: float
    frequency: float
    age: int
    significant: bool


class LongWindow:
    """One window, for the lines of one octave.

    Parameters
    ----------
    blocks : ndarray, shape (BLOCKS, 3)
        The rows of this window in those of `push`.
    length : int
        Decimated samples per block.
    sample_time : float
        Decimated sample time (s).
    alarm_rate : float
        False alarms (1/s) that noise alone may cause.
    hold : float
        Time without evidence after which an oscillation is over (s).

    Attributes
    ----------
    evidence : LineEvidence
        The tests so far.
    cause : OtherCause or None
        What the line of the latest test may be, other than a slow oscillation.
    """

    def __init__(
        self, blocks: NDArray[np.float64], length: int, sample_time: float, alarm_rate: float, hold: float
    ) -> None:
        self._blocks = blocks
        self._length = length
        self._time = length * sample_time * BLOCKS
        every = BLOCKS // EVALUATIONS
        lines = REFERENCE - int(FIRST) + 1
        level = alarm_rate * every * length * sample_time / lines
        self._critical = 1.0 - level ** (1.0 / (lines - 1))
        # A jump of the bias leaves the window after one window's time.
        self.cause: OtherCause | None = None
        self.evidence = LineEvidence(EVALUATIONS + 1, 2, max(math.ceil(hold / self._time * EVALUATIONS), 2))

    def responds(self) -> bool:
        """Whether the reference has visible motion in the band of the window."""
        return float(np.ptp(self._blocks[:, 1])) > INAUDIBLE

    def beats(self, rate: float, orders: int) -> bool:
        """Whether a harmonic of a sine folds at this sample rate (Hz) into the band, for a large part of the window.

        One that folds to zero, as the tenth of a sine at a tenth of the rate, only moves the bias.
        """
        sine = self._blocks[np.isfinite(self._blocks[:, 2]), 2]  # infinite: no input yet
        harmonics = np.arange(2, orders + 1)[:, None] * sine
        turns = np.round(harmonics / rate)
        folded = np.abs(harmonics - turns * rate)
        within = (turns > 0.0) & (folded > 1.0 / self._time) & (folded < REFERENCE / self._time)
        return bool((within.sum(axis=1) > BEATING * BLOCKS).any())

    def lowest_input(self) -> float:
        """Lowest frequency of the input within the window (Hz)."""
        return float(self._blocks[:, 2].min())

    def find(self, highest: float, smallest: float) -> SlowLine | None:
        """The largest line up to a frequency (Hz), if it has an amplitude (m) or more."""
        last = min(LAST, highest * self._time)
        if last < FIRST:
            return None
        residual = np.empty(BLOCKS)
        remove_drift(self._blocks[:, 0].copy(), residual)
        amplitude, line, share = largest_line(residual, FIRST, last, REFERENCE, TABLE)
        if amplitude < smallest:
            return None
        age = (BLOCKS - variance_change(residual)) * self._length
        return SlowLine(amplitude, line / self._time, age, share >= self._critical)


class LongWindows:
    """The windows of one axis, for the octaves from `highest` (Hz) down to `LOWEST`; parameters as for `LongWindow`.

    Attributes
    ----------
    windows : list of LongWindow
        From the shortest to the longest.
    """

    def __init__(self, highest: float, sample_time: float, alarm_rate: float, hold: float) -> None:
        lengths = [max(round(LAST / highest / sample_time / BLOCKS), 1)]
        while FIRST / (lengths[-1] * sample_time * BLOCKS) > LOWEST:
            lengths.append(2 * lengths[-1])
        self._lengths = np.array(lengths)
        self._blocks = np.zeros((len(lengths), BLOCKS, 3))
        self.windows = [
            LongWindow(self._blocks[at], length, sample_time, alarm_rate, hold) for at, length in enumerate(lengths)
        ]
        self._due = np.empty(len(lengths), np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._sums = np.zeros((len(self.windows), 3))
        self._filled, self._known = np.zeros((2, len(self.windows)), np.int64)
        for window in self.windows:
            window.evidence.reset()
            window.cause = None

    def add(self, samples: NDArray[np.float64]) -> list[tuple[LongWindow, int]]:
        """Add samples as for `push`; the windows to test, with the number of samples since their last block."""
        push(samples, self._lengths, self._sums, self._filled, self._blocks, self._known, self._due)
        return [(self.windows[at], int(self._due[at])) for at in np.flatnonzero(self._due >= 0)]
