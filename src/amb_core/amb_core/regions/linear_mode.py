"""Whether a slow line is the linear response of a lightly damped mode to the reference.

The fit of the linear response reaches back 16 ms only. A mode with little damping rings for seconds after a sweep has
passed it, and noise or a multisine keeps it ringing: its line then appears slower than the input. Here the envelopes of
reference and position about the line (signals shifted by its frequency to zero and low-pass filtered alike, which keeps
a linear relation linear) are compared with the response of one complex pole,

    z[k+1] = p z[k] + u[k],    y = a z + b u,

over several seconds. The pole must be stable: such a response can ring and decay, but not set in without its input.
The line is explained if little of it is left at the end. A mode answers its input with a bounded gain: an input that
decimation has removed explains nothing, though what rounding leaves of it may have the shape of a line.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

PERIODS = 4.0  # of the line in the low-pass filter: inputs at twice its frequency and above do not pass
PER_PERIOD = 2.0  # samples of an envelope per period of the line
LIGHTEST, HEAVIEST = 4e-3, 0.2  # damping ratios of the poles that are tried
HIGHEST_GAIN = 0.5 / LIGHTEST  # of the lightest mode at its resonance, if at rest the rotor follows its reference
DAMPINGS = 12
DETUNING = 0.06  # of the line's frequency: the pole is looked for at least so far on both sides
DETUNING_STEP = 0.012
ZOOMS, ZOOMED = 3, 7  # rounds of the search, and poles per direction in all but the first
NEIGHBOURS = 3  # samples of the input envelope on both sides: the smooth part of the response
FADE_IN = 0.15  # of the signals, in which the input is faded in
LATE = 3.0  # latest periods of the line, which the response that the whole span determines must explain
SHORTEST = 20  # samples of an envelope that are compared


def unexplained_amplitude(
    reference: NDArray[np.float64], position: NDArray[np.float64], frequency: float, resolution: float, rate: float
) -> float:
    """Amplitude of a line, in its last periods, that no linear mode explains.

    Parameters
    ----------
    reference, position : ndarray, shape (n,)
        Decimated signals (m), from before the line was there.
    frequency : float
        Of the line (Hz).
    resolution : float
        Largest error of this frequency (Hz).
    rate : float
        Sample rate (Hz).

    Returns
    -------
    float
        Root mean square amplitude (m) of what the response leaves, and at least that beyond `HIGHEST_GAIN` times the
        input; infinite if the signals are too short.
    """
    frequency = _refined(position, frequency, resolution, rate)
    every = max(round(rate / (PER_PERIOD * frequency)), 1)
    input_envelope = _envelope(reference, frequency / rate, every)
    envelope = _envelope(position, frequency / rate, every)
    samples = len(envelope)
    if samples < SHORTEST:
        return math.inf
    late = slice(samples - round(LATE * PER_PERIOD), samples)
    beyond = _mean_amplitude(envelope[late]) - HIGHEST_GAIN * 2.0 * float(np.abs(input_envelope).max())
    # An input that was there before the signals begin must not look like a blow that starts the ringing.
    begins = np.minimum((np.arange(samples) + 1.0) / (FADE_IN * samples), 1.0)
    input_envelope = input_envelope * np.sin(0.5 * np.pi * begins) ** 2
    # The smooth part of the response does not depend on the pole: it is taken out of everything once.
    around = np.column_stack([np.roll(input_envelope, shift) for shift in range(-NEIGHBOURS, NEIGHBOURS + 1)])
    smooth = np.linalg.qr(around)[0]
    envelope = envelope - smooth @ (smooth.conj().T @ envelope)
    angular = 2.0 * math.pi * frequency * every / rate
    widest = max(DETUNING, 1.2 * resolution / frequency)
    dampings = np.geomspace(LIGHTEST, HEAVIEST, DAMPINGS)
    detunings = np.linspace(-widest, widest, 2 * round(widest / DETUNING_STEP) + 1)
    for _ in range(ZOOMS):
        damping, detuning = (grid.ravel() for grid in np.meshgrid(dampings, detunings, indexing="ij"))
        response = _responses(input_envelope, np.exp(angular * (-damping + 1j * detuning)))
        response -= smooth @ (smooth.conj().T @ response)
        power = np.sum(np.abs(response) ** 2, axis=0)
        common = response.conj().T @ envelope
        best = int(np.argmax(np.abs(common) ** 2 / np.maximum(power, np.finfo(np.float64).tiny)))
        left = envelope - response[:, best] * (common[best] / max(power[best], np.finfo(np.float64).tiny))
        ratio, step = dampings[1] / dampings[0], detunings[1] - detunings[0]
        dampings = damping[best] * ratio ** np.linspace(-1.0, 1.0, ZOOMED)
        dampings = dampings[dampings >= LIGHTEST]
        detunings = detuning[best] + step * np.linspace(-1.0, 1.0, ZOOMED)
    return max(_mean_amplitude(left[late]), beyond)


def _mean_amplitude(envelope: NDArray[np.complex128]) -> float:
    """Root mean square amplitude of a line (m); its envelope is half of it."""
    return 2.0 * float(np.sqrt(np.mean(np.abs(envelope) ** 2)))


@numba.njit(cache=True, error_model="numpy")
def _responses(envelope: NDArray[np.complex128], poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Responses z of poles, one column each."""
    responses = np.zeros((len(envelope), len(poles)), np.complex128)
    for k in range(1, len(envelope)):
        for i in range(len(poles)):
            responses[k, i] = poles[i] * responses[k - 1, i] + envelope[k - 1]
    return responses


def _refined(position: NDArray[np.float64], frequency: float, resolution: float, rate: float) -> float:
    """Frequency of the line's peak in the spectrum of the latest second, or of four periods."""
    latest = position[-round(rate * max(1.0, PERIODS / frequency)) :]
    power = np.abs(np.fft.rfft((latest - latest.mean()) * np.hanning(len(latest)), 4 * len(latest)))
    grid = np.fft.rfftfreq(4 * len(latest), 1.0 / rate)
    return float(grid[np.argmax(np.where(np.abs(grid - frequency) <= resolution, power, -1.0))])


def _envelope(signal: NDArray[np.float64], cycles: float, every: int) -> NDArray[np.complex128]:
    """Complex envelope about a frequency (cycles per sample), every so many samples."""
    length = max(round(PERIODS / cycles), 3)
    if len(signal) < length:
        return np.empty(0, np.complex128)
    window = np.hanning(length + 2)[1:-1]
    shifted = (signal - signal.mean()) * np.exp(-2j * np.pi * cycles * np.arange(len(signal)))
    return np.convolve(shifted, window / window.sum(), "valid")[::every]
