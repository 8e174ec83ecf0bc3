"""Content of an excitation as sines, which can be compared with a frequency-amplitude graph.

A region map is valid for a sine of amplitude a. Signals are converted to that form in three ways:

- a sweep is a sine at every instant: its amplitude at its instantaneous frequency (`instantaneous`), not the small
  lines of a transform over the whole record;
- a square wave and a sum of tones are sines: their harmonics, their tones (`lines`);
- multisine, PRBS and white noise have lines with an amplitude that depends on the length of the record. The power in a
  band does not: each third of an octave is given as the sine of the same power (`bands`). At the upper edge of the
  loop's bandwidth, where regions begin, such a band is about as wide as the loop: lines within it beat so slowly that
  the rotor follows, and act as one sine.

Source of the bands: IEC 61260-1:2014, base ten.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import ExcitationSignal, Square, Tones

Form = Literal["instantaneous", "lines", "bands"]

INSTANTS = 400
"""Number of points that represent a sweep."""


@dataclass(frozen=True)
class Content:
    """Sines that make up a signal on one axis.

    Attributes
    ----------
    form : {"instantaneous", "lines", "bands"}
        How they follow from the signal. Sines of `instantaneous` occur one after the other, those of the others add up.
    frequency, amplitude : ndarray, shape (n,)
        Frequency (Hz) and peak amplitude (m) of each.
    share : ndarray, shape (n,)
        Share of each in the power (for a sweep also in the time); the sum is 1.
    """

    form: Form
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    share: NDArray[np.float64]


def content_of(signal: ExcitationSignal, span: tuple[int, int], axis: int) -> Content:
    """The sines of a signal on an axis.

    Parameters
    ----------
    signal : ExcitationSignal
        The signal.
    span : tuple of int
        First step at which the axis is excited, and the step after the last.
    axis : int
        0 for x, 1 for y.
    """
    parameters = signal.parameters
    if isinstance(parameters, Tones):
        frequency, amplitude = np.array(parameters.frequencies), np.array(parameters.amplitudes)
        audible = amplitude > 0.0
        return _content("lines", frequency[audible], amplitude[audible])
    if signal.frequency is not None:
        blocks = np.array_split(signal.frequency[span[0] : span[1]], min(INSTANTS, span[1] - span[0]))
        frequency = np.array([block.mean() for block in blocks])
        return _content("instantaneous", frequency, np.full(len(blocks), np.max(np.abs(signal.samples[:, axis]))))
    samples = signal.samples[span[0] : span[1], axis]
    if isinstance(parameters, Square):
        frequency, amplitude = line_spectrum(whole_periods(samples, parameters, signal.sample_time), signal.sample_time)
        audible = amplitude > 1e-6 * amplitude.max()
        return _content("lines", frequency[audible], amplitude[audible])
    return _content("bands", *_bands(*line_spectrum(samples, signal.sample_time)))


def whole_periods(samples: NDArray[np.float64], square: Square, sample_time: float) -> NDArray[np.float64]:
    """Samples of a square wave to the end of its last whole period, to avoid leakage; all if there is none."""
    periods = np.floor(len(samples) * sample_time * square.frequency + 1e-9)
    return samples[: round(periods / (square.frequency * sample_time))] if periods >= 1.0 else samples


def line_spectrum(samples: NDArray[np.float64], sample_time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (Hz) and peak amplitudes of the lines of a discrete Fourier transform, without the mean value.

    Half the sum of the squared amplitudes is the variance; the line at the Nyquist frequency is scaled to that end.
    """
    steps = len(samples)
    amplitude = 2.0 * np.abs(np.fft.rfft(samples)) / steps
    if steps % 2 == 0:
        amplitude[-1] /= np.sqrt(2.0)
    return line_frequencies(steps, sample_time), amplitude[1:]


def line_frequencies(steps: int, sample_time: float) -> NDArray[np.float64]:
    """Frequencies of the lines of `line_spectrum` for a number of samples (Hz), shape (steps // 2,)."""
    return np.arange(1, steps // 2 + 1) / (steps * sample_time)


def _bands(
    frequency: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Thirds of an octave with power in them: mean frequency by power, amplitude of the sine of the same power."""
    squared = amplitude**2
    number = np.round(10.0 * np.log10(frequency)).astype(int)
    number -= number[0]
    power = np.bincount(number, squared).astype(np.float64)
    first_moment = np.bincount(number, squared * frequency).astype(np.float64)
    heard = power > 1e-12 * power.max()
    mean: NDArray[np.float64] = first_moment[heard] / power[heard]
    return mean, np.sqrt(power[heard])


def _content(form: Form, frequency: NDArray[np.float64], amplitude: NDArray[np.float64]) -> Content:
    return Content(form, frequency, amplitude, amplitude**2 / np.sum(amplitude**2))
