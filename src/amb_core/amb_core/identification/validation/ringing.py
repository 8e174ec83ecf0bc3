"""Modes that a model lacks: what resonators that past errors and inputs drive explain of the prediction errors.

The prediction errors e of a true model are white and independent of past inputs. A mode that the model lacks leaves
a part that rings at its frequency, excited by the inputs or by noise. At each frequency of a grid lightly damped
resonators are driven by e and u,

    s[k+1] = exp((i - zeta) omega T) s[k] + (e[k], u[k]),

and e is regressed on the real and imaginary parts of s. For a true model with p outputs and m inputs what that
explains, in units of the variance, is a chi-square variable of 2 p (p + m) degrees of freedom. Single lines of e are
cut down to their neighbours first: a tone, such as that of an unbalance, is a disturbance, and no mode.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 16.6 (residual tests as regressions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.ground.errors import IdentificationError
from amb_core.identification.validation.residuals import decorrelated

Arrays = NDArray[np.float64]

NOTABLE, SHARE = 1.25, 0.1
"""Height over its neighbourhood, and error relative to the motion beside it, from which a peak is that of a mode."""
_DAMPING, _MOST_DAMPED = 0.01, 0.1
_LINES = 10.0  # half the bandwidth of a resonator at least, in lines of the record: the statistic needs as many
_STEP = 1.02  # factor from one frequency to the next
_NEIGHBOURHOOD = 35  # frequencies to either side: an octave
_HIGHEST = 0.8  # of the Nyquist frequency
_LONGEST = 20_000  # samples used
_TONE, _BESIDE = 12.0, 8  # power of a line over that of as many lines to either side


@dataclass(frozen=True)
class Ringing:
    """The highest peak.

    Attributes
    ----------
    frequency : float
        Its frequency (Hz).
    height : float
        What is explained there over the median in its neighbourhood.
    share : float
        Prediction error relative to the motion beside it, root mean squares, of the output where it is largest.
    p_value : float
        Probability of so much anywhere for a true model.
    """

    frequency: float
    height: float
    share: float
    p_value: float


def find_ringing(
    residuals: Sequence[Arrays],
    inputs: Sequence[Arrays],
    outputs: Sequence[Arrays],
    sample_time: float,
    allowance: float = 1.0,
) -> Ringing | None:
    """The most significant peak in the longest experiment; None if it is too short, or its errors are not independent.

    Parameters
    ----------
    residuals, inputs, outputs : sequences of ndarray, shapes (steps, p), (steps, m), (steps, p)
        Of each experiment.
    sample_time : float
        Sample time (s).
    allowance : float
        Variance of what the errors of a model with uncertain parameters explain, relative to a true one's.
    """
    longest = int(np.argmax([len(part) for part in residuals]))
    try:
        (e,) = decorrelated([_without_tones(residuals[longest][:_LONGEST])])
    except IdentificationError:
        return None
    u = inputs[longest][:_LONGEST]
    u = u[:, u.std(axis=0) > 0.0]
    u = (u - u.mean(axis=0)) / u.std(axis=0)
    steps, p = e.shape
    duration = steps * sample_time
    lowest, highest = _LINES / (_MOST_DAMPED * duration), _HIGHEST / (2.0 * sample_time)
    if not highest > lowest:
        return None
    grid = lowest * _STEP ** np.arange(int(np.log(highest / lowest) / np.log(_STEP)))
    if len(grid) < _NEIGHBOURHOOD:
        return None
    signals = np.ascontiguousarray(np.hstack([e, u]))
    damping = np.maximum(_DAMPING, _LINES / (grid * duration))
    poles = np.exp((1j - damping) * 2.0 * np.pi * grid * sample_time)
    explained = np.array([_explained(*_products(pole, signals, p)) for pole in poles]) / allowance
    beside = [explained[max(place - _NEIGHBOURHOOD, 0) : place + _NEIGHBOURHOOD] for place in range(len(grid))]
    level, degrees = np.array([np.median(part) for part in beside]), 2 * p * signals.shape[1]
    heights = explained / level
    # Where errors are not white anyway, that much more than beside it: a noncentral chi-square variable, nearly normal.
    spread = np.sqrt(2.0 * (degrees + 2.0 * np.maximum(level - degrees, 0.0)))
    p_values = np.maximum(special.chdtrc(degrees, explained), special.ndtr((level - explained) / spread))
    best = int(np.lexsort((-heights, p_values, heights <= NOTABLE))[0])
    frequency = np.fft.rfftfreq(len(residuals[longest]), sample_time)
    lines = (frequency > grid[best] / _STEP**2) & (frequency < grid[best] * _STEP**2)
    parts = (np.fft.rfft(item[longest] - item[longest].mean(axis=0), axis=0)[lines] for item in (residuals, outputs))
    of_errors, of_motion = (np.linalg.norm(part, axis=0) for part in parts)
    share = float(np.max(of_errors / np.maximum(of_motion, np.finfo(float).tiny)))
    p_value = min(1.0, len(grid) * float(p_values[best]))
    return Ringing(float(grid[best]), float(heights[best]), share, p_value)


def _without_tones(errors: Arrays) -> Arrays:
    """The errors with lines that stand out from those beside them cut down to these."""
    spectrum = np.fft.rfft(errors - errors.mean(axis=0), axis=0)
    power = np.sum(np.abs(spectrum) ** 2, axis=1)
    padded = np.pad(power, _BESIDE, mode="reflect")
    beside = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _BESIDE + 1), axis=1)
    level = np.ones(len(power))
    tones = power > _TONE * beside
    level[tones] = np.sqrt(beside[tones] / power[tones])
    return np.asarray(np.fft.irfft(spectrum * level[:, np.newaxis], len(errors), axis=0))


def _explained(power: Arrays, product: Arrays) -> float:
    """Squared length of the errors in the space of the regressors."""
    scale = np.sqrt(np.maximum(np.diag(power), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(power / np.outer(scale, scale))
    kept = values > 1e-10 * values[-1]
    along = vectors[:, kept].T @ (product / scale[:, np.newaxis]) / np.sqrt(values[kept])[:, np.newaxis]
    return float(np.sum(along**2))


@numba.njit(cache=True)
def _products(pole: complex, signals: Arrays, outputs: int) -> tuple[Arrays, Arrays]:
    """Sums of the products of the regressors with one another and with the errors, the first columns of the signals."""
    steps, count = signals.shape
    power, product = np.zeros((2 * count, 2 * count)), np.zeros((2 * count, outputs))
    state, row = np.zeros(count, dtype=np.complex128), np.zeros(2 * count)
    for step in range(steps):
        for column in range(count):
            row[2 * column], row[2 * column + 1] = state[column].real, state[column].imag
            state[column] = pole * state[column] + signals[step, column]
        for first in range(2 * count):
            for second in range(first + 1):
                power[first, second] += row[first] * row[second]
            for column in range(outputs):
                product[first, column] += row[first] * signals[step, column]
    for first in range(2 * count):
        for second in range(first):
            power[second, first] = power[first, second]
    return power, product
