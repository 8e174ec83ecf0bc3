"""Lines of the position that were there before the excitation: unbalance of a turning rotor, hum, a driven mode.

They are found while there is no input, by repeated removal of the largest line of the spectrum, and are then followed:
each has a phase that advances with its frequency, and a cosine and a sine amplitude. The fit of the linear response
(`amb_core.regions.slow_signal`) contains them as regressors, so neither the bias nor a slow oscillation contains what
was there before. Its solution corrects amplitudes and frequency.

A line counts only if it has the same amplitude at the beginning and at the end of the rest: one that sets in at rest is
a slow oscillation.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

LINES = 8  # lines that are followed at the same time
PEAK = 30.0  # power of a line over the median of the spectrum: noise reaches that once in 10^7 spectra of 200 lines
FADING = 0.5  # smallest ratio of a line's amplitudes at the two ends of the rest: others have set in, or decay
PADDING = 8  # of the spectrum in which lines are looked for
REFINEMENTS = 4  # Gauss-Newton steps of the frequencies
AMPLITUDE_GAIN = 0.05  # of a fitted amplitude in the one that is followed, per update
FREQUENCY_GAIN = 0.25 * AMPLITUDE_GAIN**2  # of the phase error (rad) in the phase advance per update: no overshoot
NEAR = 3.0  # periods per window between a line and the input below which the line is not corrected
SAME = 1.0  # periods per window between two lines below which they are the same


def find_lines(
    position: NDArray[np.float64], rate: float, highest: float, smallest: float
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Lines of a signal that last from its beginning to its end.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Position at rest, without input (m).
    rate : float
        Sample rate (Hz).
    highest : float
        Highest frequency of a line (Hz); the lowest has two periods in the signal.
    smallest : float
        Smallest amplitude of a line (m).

    Returns
    -------
    frequency : ndarray, shape (lines,)
        Frequencies (Hz), in the order of their power.
    amplitude : ndarray of complex, shape (lines,)
        The line at the last sample is the real part (m); one sample later it is turned by 2 pi frequency / rate.
    """
    samples = len(position)
    lowest = 2.0 * rate / samples
    frequency = np.empty(0)
    while len(frequency) < LINES:
        rest = position - _lines_and_bias(position, rate, frequency)[1]
        candidate = _largest_peak(rest, rate, lowest, highest)
        if math.isnan(candidate):
            break
        tried = _refine(position, rate, np.append(frequency, candidate))
        apart = np.diff(np.sort(tried), prepend=0.0)
        if apart.min() < 0.5 * lowest or tried.max() > 1.05 * highest:
            break
        if abs(_lines_and_bias(position, rate, tried)[0][-1]) < smallest:
            break
        frequency = tried
    amplitude = _lines_and_bias(position, rate, frequency)[0]
    lasting = _lasting(position, rate, frequency)
    return frequency[lasting], amplitude[lasting]


def _lines_and_bias(
    position: NDArray[np.float64], rate: float, frequency: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Amplitudes of lines at the last sample, and the fitted signal: lines on a bias that is quadratic in time."""
    columns = _columns(len(position), rate, frequency)
    solution = np.linalg.lstsq(columns, position, rcond=None)[0]
    count = len(frequency)
    return solution[3 : 3 + count] - 1j * solution[3 + count :], columns @ solution


def _columns(samples: int, rate: float, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    time = np.arange(1 - samples, 1) / rate
    angle = 2.0 * np.pi * np.outer(time, frequency)
    relative = 2.0 * time / max(samples / rate, 1e-9) + 1.0
    return np.column_stack([np.ones(samples), relative, relative**2, np.cos(angle), np.sin(angle)])


def _largest_peak(rest: NDArray[np.float64], rate: float, lowest: float, highest: float) -> float:
    """Frequency of the largest line of a spectrum; NaN if it does not stand out."""
    samples = len(rest)
    power = np.abs(np.fft.rfft(rest * np.hanning(samples), PADDING * samples)) ** 2
    frequency = np.fft.rfftfreq(PADDING * samples, 1.0 / rate)
    band = (frequency >= lowest) & (frequency <= highest)
    if not band.any():
        return math.nan
    peak = int(np.argmax(np.where(band, power, 0.0)))
    return float(frequency[peak]) if power[peak] > PEAK * np.median(power[band]) else math.nan


def _refine(position: NDArray[np.float64], rate: float, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Frequencies that fit best, by Gauss-Newton steps on all parameters of the lines."""
    samples = len(position)
    time = np.arange(1 - samples, 1) / rate
    count = len(frequency)
    for _ in range(REFINEMENTS):
        columns = _columns(samples, rate, frequency)
        solution = np.linalg.lstsq(columns, position, rcond=None)[0]
        cosine, sine = columns[:, 3 : 3 + count], columns[:, 3 + count :]
        slope = 2.0 * np.pi * time[:, None] * (solution[3 + count :] * cosine - solution[3 : 3 + count] * sine)
        scale = np.abs(slope).max(axis=0) + 1e-300
        step = np.linalg.lstsq(np.hstack([columns, slope / scale]), position, rcond=None)[0][-count:] / scale
        frequency = frequency + np.clip(step, -0.5 * rate / samples, 0.5 * rate / samples)
    return frequency


def _lasting(position: NDArray[np.float64], rate: float, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which lines have about the same amplitude in both halves of a signal."""
    half = len(position) // 2
    early = np.abs(_lines_and_bias(position[:half], rate, frequency)[0])
    late = np.abs(_lines_and_bias(position[half:], rate, frequency)[0])
    return np.minimum(early, late) >= FADING * np.maximum(early, late)


class SteadyLines:
    """The lines of one axis, in a window of decimated samples that advances by an update interval at a time.

    Parameters
    ----------
    samples : int
        Decimated samples of the window.
    advance : int
        Decimated samples per update.
    rate : float
        Decimated sample rate (Hz).

    Attributes
    ----------
    frequency : ndarray, shape (lines,)
        Frequencies (Hz).
    amplitude : ndarray of complex, shape (lines,)
        The line at the last sample of the window is the real part (m).
    """

    def __init__(self, samples: int, advance: int, rate: float) -> None:
        self._samples = samples
        self._advance = advance
        self._rate = rate
        self.frequency = np.empty(0)
        self.amplitude = np.empty(0, np.complex128)

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def largest(self) -> tuple[float, float]:
        """Frequency (Hz) and amplitude (m) of the largest line; zeros without lines."""
        if not len(self):
            return 0.0, 0.0
        line = int(np.argmax(np.abs(self.amplitude)))
        return float(self.frequency[line]), float(abs(self.amplitude[line]))

    def expect(self, frequency: NDArray[np.float64]) -> None:
        """Follow lines at known frequencies (Hz), such as that of the turning rotor, whatever their amplitude."""
        self._add(frequency, np.zeros(len(frequency), np.complex128))

    def adopt(self, frequency: NDArray[np.float64], amplitude: NDArray[np.complex128]) -> None:
        """Follow the lines from `find_lines` that are not followed yet; their last sample is that of the window."""
        window = self._samples / self._rate
        new = [at for at, value in enumerate(frequency) if np.all(np.abs(self.frequency - value) * window >= SAME)]
        self._add(frequency[new], amplitude[new])

    def _add(self, frequency: NDArray[np.float64], amplitude: NDArray[np.complex128]) -> None:
        free = LINES - len(self)
        self.frequency = np.append(self.frequency, frequency[:free])
        self.amplitude = np.append(self.amplitude, amplitude[:free])

    def proceed(self) -> None:
        """The window advances by an update."""
        self.amplitude = self.amplitude * np.exp(2j * np.pi * self.frequency * self._advance / self._rate)

    def columns(self) -> NDArray[np.float64]:
        """Cosine and sine of the phase of each line over the window, shape (2 lines, samples)."""
        columns = np.empty((2 * len(self), self._samples))
        phases(self.frequency / self._rate, columns)
        return columns

    def prior(self) -> NDArray[np.float64]:
        """Cosine and sine amplitudes (m) of the lines as they are followed, shape (2 lines,)."""
        return np.column_stack([self.amplitude.real, -self.amplitude.imag]).ravel()

    def correct(self, fitted: NDArray[np.float64], input_frequency: float, steady_input: bool) -> None:
        """Follow amplitudes fitted to the window.

        Parameters
        ----------
        fitted : ndarray, shape (2 lines,)
            Cosine and sine amplitudes (m), from the fit with `prior`.
        input_frequency : float
            Frequency of the input (Hz), near which a line cannot be distinguished from the response; 0 without input.
        steady_input : bool
            Whether the input is absent or a sine. Another input has lines of its own: frequencies are then kept.
        """
        if not len(self):
            return
        window = self._samples / self._rate
        phasors = fitted[0::2] - 1j * fitted[1::2]
        apart = np.abs(self.frequency - input_frequency) * window >= NEAR
        moved = self.amplitude + AMPLITUDE_GAIN * (phasors - self.amplitude)
        resolved = apart & (self.frequency * window >= 2.0) & (np.abs(self.amplitude) > 0.0)
        if steady_input:
            turned = np.angle(phasors * np.conj(self.amplitude))
            error = np.where(resolved, turned, 0.0)
            self.frequency = self.frequency + FREQUENCY_GAIN * error * self._rate / (2.0 * np.pi * self._advance)
        self.amplitude = np.where(apart, moved, self.amplitude)


@numba.njit(cache=True, error_model="numpy")
def phases(cycles: NDArray[np.float64], columns: NDArray[np.float64]) -> None:
    """Cosine and sine rows of lines with these cycles per sample; the phase is 0 at the last sample."""
    samples = columns.shape[1]
    for line in range(len(cycles)):
        angle = 2.0 * np.pi * cycles[line]
        for k in range(samples):
            columns[2 * line, k] = np.cos(angle * (k + 1 - samples))
            columns[2 * line + 1, k] = np.sin(angle * (k + 1 - samples))
