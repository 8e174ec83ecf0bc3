"""What data show of the error of a model's response at every frequency, and what they leave open: its model-error band.

The simulation errors d = H e of a model G (e the one-step prediction errors, H the noise model) on data of a plant G_0
are (G_0 - G) u + v. A mode at f with damping ratio zeta that the model lacks adds R phi to the response, with

    phi(f') = 1 / (1 + i (f' - f) / (zeta f)),

R of p outputs and m inputs being the error at its peak. R follows from the lines about f of the discrete Fourier
transforms by least squares, with the references in the place of the inputs as instruments, since they contain no noise.
The transient of the mode has the same shape and is removed first. The scatter of the rest gives the confidence.

This is repeated at every frequency, from the least damping that is assumed to errors as broad as an octave. Where lines
are too far apart for a mode of the least damping, it could hide between them: the error seen with the narrowest mode
that the lines resolve is widened by as much as the peak of the narrower one is higher. Where nothing is excited, the
band is infinite.

A loop sees of an error D only its product with the loop's action A = C S, from references to currents. At a resonance
of the plant, currents in the direction of the mode are small: data of a loop then say little of D, and enough of D A.
So the band of a loop is that of the product.

Sources: L. Ljung, Model validation and model error modeling, in B. Wittenmark and A. Rantzer (eds.), The Astrom
Symposium on Control, 1999; W. Reinelt, A. Garulli and L. Ljung, Comparing different approaches to model error modeling
in robust identification, Automatica 38 (2002).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.prediction import predict
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.robustness.mode_fits import Lines, Spectra, fit_modes, lines_of

WIDER = 4.0  # factor from one damping ratio to the next; one in between is seen with no less than its peak
BROADEST = 0.3  # damping ratio of the broadest error
HIGHEST = 0.98  # of half the sample rate
_LEAST_POWER = 1e-10  # of the references at a frequency, relative to the largest


@dataclass(frozen=True, eq=False)
class ErrorBand:
    """Error of a model's response over frequency, largest singular value, as it is or times the action of a loop.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz), so close that no mode lies between them.
    shown : ndarray, shape (f,)
        Error that the data show (m/A, or without unit).
    open : ndarray, shape (f,)
        Error that the data leave open beside it, in the same unit; infinite where they say nothing.
    damping : float
        Least damping ratio of the modes.
    narrower : ndarray, shape (k,)
        Frequencies (Hz) at which the data show a mode of less damping.
    """

    frequency: Arrays
    shown: Arrays
    open: Arrays
    damping: float
    narrower: Arrays

    def within(self, frequency: Arrays) -> tuple[Arrays, Arrays]:
        """Largest shown error, and largest of both together, from the middle before each frequency to that after it.

        The first and last frequency are ends.
        """
        middle = np.sqrt(frequency[:-1] * frequency[1:])
        edges = np.searchsorted(self.frequency, np.concatenate([frequency[:1], middle, frequency[-1:]]))
        below = np.clip(np.searchsorted(self.frequency, frequency, side="right") - 1, 0, None)
        largest = []
        for values in (self.shown, self.shown + self.open):
            at = values[below]
            cells = itertools.pairwise(edges)
            parts = [float(values[low:high].max(initial=0.0)) for low, high in cells]
            largest.append(np.maximum(at, parts))
        return largest[0], largest[1]


def error_band(
    model: StateSpaceModel,
    records: Sequence[IdentificationData],
    damping: float,
    ring_down: float = math.inf,
    action: Callable[[Arrays], Complexes] | None = None,
) -> ErrorBand | None:
    """The band that records of a loop show of a model; None if none of them has a reference that moves.

    Parameters
    ----------
    model : StateSpaceModel
        The model; its predictor must be stable.
    records : sequence of IdentificationData
        Data of the same loop, with trends as they were recorded. Where one contradicts the others, the bearing has
        changed in between, and the largest error of them counts.
    damping : float
        Least damping ratio of modes that the model may lack.
    ring_down : float
        Longest time constant of their decay (s): slow modes are damped more.
    action : callable, optional
        What errors are multiplied by, from frequencies (Hz), shape (f,), to (f, m, m); nothing by default.
    """
    spectra = [one for data in records if (one := _spectra(model, data))]
    if not spectra:
        return None
    experiments = [item for one in spectra for item in one]
    least = _LEAST_POWER * max(float(np.mean(item.power)) for item in experiments)
    first = min(float(item.frequency[item.power > least].min(initial=math.inf)) for item in experiments)
    lines = lines_of(spectra, least)
    last = HIGHEST * 0.5 / model.sample_time
    if not 0.0 < first < last:
        return None
    frequency = first * np.exp(damping * np.arange(int(math.log(last / first) / damping) + 1))
    weight = np.broadcast_to(np.eye(model.inputs, dtype=np.complex128), (len(frequency), model.inputs, model.inputs))
    if action is not None:
        weight = action(frequency)
    shown, open_ = np.zeros(len(frequency)), np.full(len(frequency), -math.inf)
    resolved = np.zeros(len(frequency), dtype=bool)
    least_damped = np.maximum(damping, 1.0 / (2.0 * np.pi * frequency * ring_down))
    ratio, step = damping, 1
    while ratio <= BROADEST:
        places = np.arange(0, len(frequency), step)
        fitted = fit_modes(lines, frequency[places], ratio, weight[places])
        size, left = (np.interp(np.arange(len(frequency)), places, values) for values in fitted)
        known = np.isfinite(left)
        # A mode narrower than this one that hides between the lines is higher, and seen with less than its peak.
        hidden = np.where(known & ~resolved, np.maximum(1.0, 0.5 * (ratio / least_damped + 1.0)), 1.0)
        shown[known] = np.maximum(shown[known], size[known])
        both = np.where(known, hidden * (np.where(known, size, 0.0) + np.where(known, left, 0.0)), -math.inf)
        open_ = np.maximum(open_, both)
        resolved |= known
        ratio, step = ratio * WIDER, step * round(WIDER)
    open_ = np.where(resolved, np.maximum(open_ - shown, 0.0), math.inf)
    shown = np.where(resolved, shown, 0.0)
    return ErrorBand(frequency, shown, open_, damping, _narrower(lines, frequency, weight, shown, open_, damping))


def _narrower(
    lines: Lines, frequency: Arrays, weight: Complexes, shown: Arrays, open_: Arrays, damping: float
) -> Arrays:
    """Where the data show a mode with less damping than any is assumed to have.

    The band shows it with less than its peak, as a maximum; a narrower shape shows more. The difference of two allowed
    modes, of bearing and model, looks half as high at most (phi^2 fitted by phi): only what is higher still counts.
    """
    beside = np.maximum(np.append(shown[1:], 0.0), np.append(0.0, shown[:-1]))
    ratio, places = damping / WIDER, np.flatnonzero((shown > open_) & (shown >= beside))
    offsets = ratio * np.arange(-round(WIDER), round(WIDER) + 1)
    about = frequency[places, np.newaxis] * np.exp(offsets)
    same = np.repeat(weight[places], len(offsets), axis=0)
    size, left = (values.reshape(about.shape) for values in fit_modes(lines, about.ravel(), ratio, same))
    return np.asarray(frequency[places[(size - left).max(axis=1) > 2.0 * shown[places] + open_[places]]])


def _spectra(model: StateSpaceModel, data: IdentificationData) -> list[Spectra]:
    """Spectra of the experiments whose references move."""
    noise = LinearSystem(model.a, model.k, model.c, np.eye(model.outputs), model.sample_time)
    spectra = []
    try:
        residuals = predict(model, data).residuals
    except IdentificationError:
        return []
    for item, errors in zip(data.experiments, residuals, strict=True):
        if item.reference is None or not np.ptp(item.reference, axis=0).any():
            continue
        frequency = np.asarray(np.fft.rfftfreq(len(errors), data.sample_time)[1:], dtype=np.float64)
        parts = (item.reference, item.inputs, errors)
        r, u, e = (np.fft.rfft(part - part.mean(axis=0), axis=0)[1:] / math.sqrt(len(part)) for part in parts)
        d = (noise.response(frequency) @ e[:, :, np.newaxis])[:, :, 0]
        spectra.append(Spectra(frequency, r, u, d))
    return spectra
