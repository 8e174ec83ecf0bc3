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

Sources: L. Ljung, Model validation and model error modeling, in B. Wittenmark and A. Rantzer (eds.), The Astrom
Symposium on Control, 1999; W. Reinelt, A. Garulli and L. Ljung, Comparing different approaches to model error modeling
in robust identification, Automatica 38 (2002).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.prediction import predict
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.linear.model import StateSpaceModel

CONFIDENCE = 0.999  # at each frequency
WIDER = 4.0  # factor from one damping ratio to the next; one in between is seen with no less than its peak
BROADEST = 0.3  # damping ratio of the broadest error
HIGHEST = 0.98  # of half the sample rate
_REACH = 8.0  # half bandwidths of a mode to either side, from which lines are taken
_FEWEST = 4.0  # free terms for each reference
_LEAST_POWER = 1e-10  # of the references at a frequency, relative to the largest
_LEAST_INDEPENDENCE = 1e-5
_NEAR = 0.25  # of the power that drives a mode, within its half bandwidth: half of it if all is excited alike
_LEAST_KEPT = 0.1  # of that power without what looks like a transient; the ends of a record do


@dataclass(frozen=True, eq=False)
class ErrorBand:
    """Error of a model's response, largest singular value, over frequency.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz), so close that no mode lies between them.
    shown : ndarray, shape (f,)
        Error that the data show (m/A).
    open : ndarray, shape (f,)
        Error that the data leave open beside it (m/A); infinite where they say nothing.
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
        found = []
        for values in (self.shown, self.shown + self.open):
            at = values[below]
            cells = itertools.pairwise(edges)
            parts = [float(values[low:high].max(initial=0.0)) for low, high in cells]
            found.append(np.maximum(at, parts))
        return found[0], found[1]


def error_band(
    model: StateSpaceModel, records: Sequence[IdentificationData], damping: float, ring_down: float = math.inf
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
    """
    by_record = [one for data in records if (one := _spectra(model, data))]
    spectra = [item for one in by_record for item in one]
    if not spectra:
        return None
    largest = max(float(np.mean(np.sum(np.abs(item.r) ** 2, axis=1))) for item in spectra)
    least = _LEAST_POWER * largest
    first = min(float(item.frequency[item.power > least].min(initial=math.inf)) for item in spectra)
    last = HIGHEST * 0.5 / model.sample_time
    if not 0.0 < first < last:
        return None
    frequency = first * np.exp(damping * np.arange(int(math.log(last / first) / damping) + 1))
    shown, open_ = np.zeros(len(frequency)), np.full(len(frequency), -math.inf)
    resolved = np.zeros(len(frequency), dtype=bool)
    least_damped = np.maximum(damping, 1.0 / (2.0 * np.pi * frequency * ring_down))
    ratio, step = damping, 1
    while ratio <= BROADEST:
        places = np.arange(0, len(frequency), step)
        found = np.array([_mode(by_record, float(frequency[place]), ratio, least) for place in places])
        size, left = (np.interp(np.arange(len(frequency)), places, column) for column in found.T)
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
    return ErrorBand(frequency, shown, open_, damping, _narrower(by_record, frequency, shown, open_, damping, least))


def _narrower(
    records: Sequence[Sequence[_Spectra]], frequency: Arrays, shown: Arrays, open_: Arrays, damping: float, least: float
) -> Arrays:
    """Where the data show a mode with less damping than any is assumed to have.

    The band shows it with less than its peak, as a maximum; a narrower shape shows more. The difference of two allowed
    modes, of bearing and model, looks half as high at most (phi^2 fitted by phi): only what is higher still counts.
    """
    beside = np.maximum(np.append(shown[1:], 0.0), np.append(0.0, shown[:-1]))
    ratio, found = damping / WIDER, []
    offsets = ratio * np.arange(-round(WIDER), round(WIDER) + 1)
    for place in np.flatnonzero((shown > open_) & (shown >= beside)):
        fits = [_mode(records, at, ratio, least) for at in (frequency[place] * np.exp(offsets)).tolist()]
        if max(size - left for size, left in fits) > 2.0 * shown[place] + open_[place]:
            found.append(float(frequency[place]))
    return np.array(found)


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Lines of references, inputs and simulation errors of an experiment."""

    frequency: Arrays
    r: Complexes
    u: Complexes
    d: Complexes

    @cached_property
    def power(self) -> Arrays:
        return np.asarray(np.sum(np.abs(self.r) ** 2, axis=1))


def _spectra(model: StateSpaceModel, data: IdentificationData) -> list[_Spectra]:
    noise = LinearSystem(model.a, model.k, model.c, np.eye(model.outputs), model.sample_time)
    found = []
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
        found.append(_Spectra(frequency, r, u, d))
    return found


def _mode(records: Sequence[Sequence[_Spectra]], at: float, damping: float, least: float) -> tuple[float, float]:
    """Error at the peak of a mode, and what is open beside it; infinite where the lines do not determine it.

    All records together determine it best if they are of one bearing. One that contradicts this counts alone.
    """
    near = [[part for item in record if (part := _near(item, at, damping, least)) is not None] for record in records]
    together = _fitted([part for parts in near for part in parts])
    if together is None:
        return 0.0, math.inf
    found = [together]
    if len(records) > 1:
        alone = [fit for parts in near if (fit := _fitted(parts)) is not None]
        found += [fit for fit in alone if float(np.linalg.norm(fit.error - together.error, 2)) > fit.open]
    return max(((fit.size, fit.open) for fit in found), key=sum)


@dataclass(frozen=True, eq=False)
class _Near:
    """Lines about a mode, its shape applied and its transient removed, and how many count."""

    r: Complexes
    u: Complexes
    d: Complexes
    lines: float


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Error at the peak of a mode, and what is open beside it."""

    error: Complexes
    open: float

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.error, 2))


def _near(item: _Spectra, at: float, damping: float, least: float) -> _Near | None:
    """The lines of an experiment that show a mode; None if they do not."""
    half = damping * at
    part = slice(*np.searchsorted(item.frequency, [at - _REACH * half, at + _REACH * half]))
    here = item.frequency[part]
    if len(here) < 3 or not np.any(item.power[part] > least):
        return None
    shape = 1.0 / (1.0 + 1j * (here - at) / half)
    beside = shape / math.sqrt(float(np.sum(np.abs(shape) ** 2)))
    weight = np.abs(shape) ** 2 * item.power[part]
    near = weight[np.abs(here - at) <= half]
    moved = item.r[part] * shape[:, np.newaxis]
    kept = moved - np.outer(beside, beside.conj() @ moved)
    if near.sum() < _NEAR * weight.sum() or np.linalg.norm(kept) ** 2 < _LEAST_KEPT * weight.sum():
        return None
    driven = item.u[part] * shape[:, np.newaxis]
    return _Near(
        kept,
        driven - np.outer(beside, beside.conj() @ driven),
        item.d[part] - np.outer(beside, beside.conj() @ item.d[part]),
        float(np.sum(weight)) ** 2 / float(np.sum(weight**2)),
    )


def _fitted(parts: Sequence[_Near]) -> _Fitted | None:
    """The error by instrumental variables; None if the lines do not determine it."""
    if not parts:
        return None
    references, lines = parts[0].r.shape[1], sum(part.lines for part in parts)
    free = lines - references - 1.0
    if free < _FEWEST * references:
        return None
    z, x, y = (np.vstack([getattr(part, name) for part in parts]) for name in ("r", "u", "d"))
    rr, ur, yr = z.T @ z.conj(), x.T @ z.conj(), y.T @ z.conj()
    scale = np.sqrt(np.diag(rr).real)
    if not np.all(scale > 0.0) or np.linalg.eigvalsh(rr / np.outer(scale, scale))[0] < _LEAST_INDEPENDENCE:
        return None
    try:
        inverse = np.linalg.inv(ur)
    except np.linalg.LinAlgError:
        return None
    error = yr @ inverse
    rest = y - x @ error.T
    gain = np.sum(np.abs(z.conj() @ inverse) ** 2, axis=1)
    count = error.size
    variance = float(np.sum(np.sum(np.abs(rest) ** 2, axis=1) * gain)) * lines / free
    quantile = float(special.fdtri(2 * count, 2.0 * free, CONFIDENCE))
    return _Fitted(error, math.sqrt(quantile * variance))
