"""Modes that a model lacks: what resonators that past errors and inputs drive explain of the prediction errors.

The prediction errors e of a true model are white and independent of past inputs. A mode that the model lacks leaves
a part that rings at its frequency, excited by the inputs or by noise. At each frequency of a grid lightly damped
resonators are driven by e and u,

    s[k+1] = exp((i - zeta) omega T) s[k] + (e[k], u[k]),

and e is regressed on the real and imaginary parts of s. Below its resonance s follows what drives it, so that at every
frequency it would explain what a wrong gain or a wrong slow mode leaves in e, and no peak would stand out. What e and u
of the last samples explain is therefore removed from e and from s, and so is what gains, dead times and stiffness that
deviate would do: their effect lasts as long as the predictor remembers, and where the excitation ends it has an edge
that looks like a peak. For a true model with p outputs and m inputs what the rest of s explains, in units of the
variance, is a chi-square variable of 2 p (p + m) degrees of freedom. Tones of e are subtracted first: one, such as that
of an unbalance, is a disturbance, and no mode.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 16.6 (residual tests as regressions).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.data.experiments.tones import find_tones, without_tones
from amb_core.ground.errors import IdentificationError
from amb_core.identification.validation import largest_root
from amb_core.identification.validation.residuals import decorrelated
from amb_core.identification.validation.verdict import SIGNIFICANT

Arrays = NDArray[np.float64]

NOTABLE, SHARE = 1.25, 0.1
"""Height over its neighbourhood, and error relative to the motion beside it, from which a peak is that of a mode."""
LONGEST = 20_000
"""Samples used."""
_DAMPING, _MOST_DAMPED = 0.01, 0.1
_LINES = 10.0  # half the bandwidth of a resonator at least, in lines of the record: the statistic needs as many
_STEP = 1.02  # factor from one frequency to the next
_NEIGHBOURHOOD = 35  # frequencies to either side: an octave
_PAST = 2  # samples before of errors and inputs, whose part is removed
_HIGHEST = 0.8  # of the Nyquist frequency
_ALIKE = 1e-10  # eigenvalue of columns of length 1, relative to the largest, below which it is rounding
_NOTHING = 1e-13  # square of what is left of a column of length 1, below which it is rounding


@dataclass(frozen=True)
class Ringing:
    """The most significant peak, of those that refuse a model if there are any.

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
    p_estimated : float
        The same for a model that was estimated from as few samples as this one.
    """

    frequency: float
    height: float
    share: float
    p_value: float
    p_estimated: float


def find_ringing(
    residuals: Sequence[Arrays],
    inputs: Sequence[Arrays],
    outputs: Sequence[Arrays],
    sample_time: float,
    variance_of_estimate: float = 1.0,
    effects: Callable[[int], Arrays] | None = None,
) -> Ringing | None:
    """The most significant peak in the longest experiment; None if it is too short, or its errors are not independent.

    Parameters
    ----------
    residuals, inputs, outputs : sequences of ndarray, shapes (steps, p), (steps, m), (steps, p)
        Of each experiment.
    sample_time : float
        Sample time (s).
    variance_of_estimate : float
        Variance of what the errors of a model with uncertain parameters explain, relative to a true one's.
    effects : callable, optional
        Called with the number of an experiment; returns what deviations that are no modes do to its errors, shape
        (steps, d), of `LONGEST` samples or all. None for none.
    """
    longest = int(np.argmax([len(part) for part in residuals]))
    try:
        tones, motion = find_tones(residuals[longest][:LONGEST]), outputs[longest][:LONGEST]
        (e,) = decorrelated([tones.rest])
        u = without_tones(inputs[longest][: len(e)], tones.frequencies)
        u = u[:, u.std(axis=0) > 0.0]
        signals = np.ascontiguousarray(np.hstack([e, (u - u.mean(axis=0)) / u.std(axis=0)]))
        others = np.empty((len(e), 0)) if effects is None else effects(longest)
        past = _basis(signals, others)
        (rest,) = decorrelated([_without(past, e[_PAST:])])
    except IdentificationError:
        return None
    steps, p = e.shape
    duration = steps * sample_time
    lowest, highest = _LINES / (_MOST_DAMPED * duration), _HIGHEST / (2.0 * sample_time)
    if not highest > lowest:
        return None
    grid = lowest * _STEP ** np.arange(int(np.log(highest / lowest) / np.log(_STEP)))
    if len(grid) < _NEIGHBOURHOOD:
        return None
    damping = np.maximum(_DAMPING, _LINES / (grid * duration))
    poles = np.exp((1j - damping) * 2.0 * np.pi * grid * sample_time)
    states = (_states(pole, signals)[_PAST:] for pole in poles)
    explained = np.array([_explained(rest, one, past) for one in states])
    beside = [explained[max(place - _NEIGHBOURHOOD, 0) : place + _NEIGHBOURHOOD] for place in range(len(grid))]
    level, rows = np.array([np.median(part) for part in beside]), 2 * signals.shape[1]
    heights = explained / level
    p_values, p_estimated = (
        len(grid) * _by_chance(explained / scale, level / scale, rows, p) for scale in (1.0, variance_of_estimate)
    )
    shares = _shares(tones.rest, motion, grid * sample_time)
    high = heights > NOTABLE
    refuses = high & (p_values < SIGNIFICANT) & (shares > SHARE)  # a small peak does not hide one that matters
    best = np.lexsort((-heights, p_values, ~high, ~refuses))[0]
    found = grid, heights, shares, np.minimum(p_values, 1.0), np.minimum(p_estimated, 1.0)
    return Ringing(*(float(values[best]) for values in found))


def _by_chance(explained: Arrays, level: Arrays, rows: int, p: int) -> Arrays:
    """Probability of so much at each frequency for a true model, `level` being what is explained beside it."""
    # Where errors are not white anyway, that much more than beside it: a noncentral chi-square variable, nearly normal.
    spread = np.sqrt(2.0 * (level + np.maximum(level - largest_root.mean(rows, p), 0.0)))
    return np.maximum(largest_root.survival(explained, rows, p), special.ndtr((level - explained) / spread))


def _shares(errors: Arrays, motion: Arrays, frequencies: Arrays) -> Arrays:
    """Errors relative to the motion within two steps of each frequency (1 / sample), of the output where it is most."""
    lines = np.fft.rfftfreq(len(errors))
    first, last = (np.searchsorted(lines, frequencies * _STEP**side) for side in (-2, 2))
    spectra = (np.abs(np.fft.rfft(signal - signal.mean(axis=0), axis=0)) ** 2 for signal in (errors, motion))
    below = (np.vstack([np.zeros(signal.shape[1]), np.cumsum(signal, axis=0)]) for signal in spectra)
    of_errors, of_motion = (sums[last] - sums[first] for sums in below)
    return np.asarray(np.sqrt(np.max(of_errors / np.maximum(of_motion, np.finfo(float).tiny), axis=1)))


def _basis(signals: Arrays, others: Arrays) -> Arrays:
    """Orthonormal columns that span others and the signals of the last samples, as far as there are all of them."""
    lagged = [signals[_PAST - lag : len(signals) - lag] for lag in range(1, _PAST + 1)]
    columns = np.hstack([*lagged, others[_PAST:]])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > _ALIKE * values[-1]
    return np.asarray(np.linalg.qr(columns @ vectors[:, kept])[0])


def _without(basis: Arrays, values: Arrays) -> Arrays:
    """What orthonormal columns do not explain."""
    return np.asarray(values - basis @ (basis.T @ values))


def _explained(errors: Arrays, regressors: Arrays, removed: Arrays) -> float:
    """Squared length of a combination of errors in the space of what orthonormal columns leave of regressors."""
    scaled = regressors / np.maximum(np.linalg.norm(regressors, axis=0), np.finfo(float).tiny)
    along = removed.T @ scaled
    power = scaled.T @ scaled - along.T @ along
    left = np.sqrt(np.maximum(np.diag(power), _NOTHING))
    values, vectors = np.linalg.eigh(power / np.outer(left, left))
    kept = values > _ALIKE * values[-1]
    along = vectors[:, kept].T @ ((scaled / left).T @ errors) / np.sqrt(values[kept])[:, np.newaxis]
    return float(np.linalg.norm(along, 2) ** 2)


@numba.njit(cache=True)
def _states(pole: complex, signals: Arrays) -> Arrays:
    """Real and imaginary parts of the resonators that the signals drive, from state zero, shape (steps, 2 signals)."""
    steps, count = signals.shape
    states, state = np.empty((steps, 2 * count)), np.zeros(count, dtype=np.complex128)
    for step in range(steps):
        for column in range(count):
            states[step, 2 * column], states[step, 2 * column + 1] = state[column].real, state[column].imag
            state[column] = pole * state[column] + signals[step, column]
    return states
