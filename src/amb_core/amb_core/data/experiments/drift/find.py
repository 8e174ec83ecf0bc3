"""Whether outputs drift: the slow part of the errors of a model that knows no drift.

Errors of a long ARX model (see `autoregression`) are white noise where nothing drifts: the lines of their cosine
transform then have one mean power. Drift of any shape (ramp, wave, step, random walk) puts power into the lowest lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.drift.autoregression import LAGS, Autoregression, fit, scales, signals_of
from amb_core.data.experiments.drift.prefilter import high_pass
from amb_core.linear.numerics import one_blas_thread

FEWEST_SAMPLES = 1_000
"""Experiments with fewer samples are too short for the check."""

LEVEL = 43.0
"""Power of the slow lines relative to the others from which outputs count as drifting.

It is 1 +- 0.4 without drift for a linear plant. The bias of a loaded bearing follows the amplitude of its excitation a
little: on simulated bearings without drift up to 36 was seen, with drift of 2 to 5 um 50 and more."""

SLOWEST = 16
"""Number of slow lines: up to as many half cycles an experiment."""

_OTHERS = 16 * SLOWEST  # lines that show the level without drift
_CHI_SQUARE_MEDIAN = 0.4549  # of one degree of freedom and mean 1


@dataclass(frozen=True)
class Drift:
    """Evidence of drift.

    Attributes
    ----------
    power : ndarray, shape (p,)
        Mean power of the slow lines of each output's errors, relative to that of the lines above them (-).
    size : ndarray, shape (p,)
        Estimated range of the slow part of each output that the inputs do not explain (its unit).
    """

    power: NDArray[np.float64]
    size: NDArray[np.float64]

    @property
    def found(self) -> bool:
        """Whether an output drifts."""
        return bool(np.any(self.power > LEVEL))


def find_drift(data: IdentificationData) -> Drift | None:
    """Look for drift of the outputs; None if the samples are too few or determine no ARX model.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values; means of each experiment do not count.

    Returns
    -------
    Drift or None
        How strongly each output drifts; None if it cannot be decided.
    """
    kept = long_enough(data)
    model = None if kept is None else undrifted(kept)
    if kept is None or model is None:
        return None
    p = len(data.output_names)
    slow, level, size = np.zeros(p), np.zeros(p), np.zeros(p)
    to_outputs = np.linalg.pinv(model.static_gain) * scales(kept)[len(data.input_names) :, np.newaxis]
    for part in signals_of(kept):
        lines = fft.dct(model.errors(part), axis=0, norm="ortho")
        power = lines[1 : SLOWEST + 1 + _OTHERS] ** 2
        slow = slow + power[:SLOWEST].mean(axis=0)
        level = level + np.median(power[SLOWEST:], axis=0) / _CHI_SQUARE_MEDIAN
        lines[0], lines[SLOWEST + 1 :] = 0.0, 0.0
        size = np.maximum(size, np.ptp(fft.idct(lines, axis=0, norm="ortho") @ to_outputs.T, axis=0))
    return Drift(np.asarray(slow / np.maximum(level, np.finfo(float).tiny)), size)


def long_enough(data: IdentificationData) -> IdentificationData | None:
    """The experiments with enough samples; None if there are none, or a signal of theirs is constant."""
    kept = [index for index, item in enumerate(data.experiments) if item.steps >= FEWEST_SAMPLES]
    if not kept:
        return None
    data = data.subset(kept)
    moves = [np.ptp(np.hstack([item.inputs, item.outputs]), axis=0) > 0.0 for item in data.experiments]
    return data if np.all(np.any(moves, axis=0)) else None


def undrifted(data: IdentificationData) -> Autoregression | None:
    """The ARX model of the data without their slow part; None if they determine none."""
    shortest = min(item.steps for item in data.experiments)
    filtered = high_pass(data, shortest // SLOWEST | 1)
    factor = scales(data)
    parts = [np.hstack([item.inputs, item.outputs]) / factor for item in filtered.experiments]
    if sum(len(part) - LAGS for part in parts) < 2 * LAGS * parts[0].shape[1]:
        return None
    try:
        with one_blas_thread():
            return fit(parts, len(data.output_names))
    except linalg.LinAlgError:
        return None
