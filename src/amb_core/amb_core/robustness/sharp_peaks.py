"""Narrow resonances in the response to references: found between the lines of a record, and measured at their peaks.

A lightly damped mode is narrower than the bands of `local_response`, whose polynomials then smooth it away. Near one
the response is a mode on a smooth background, and its ringing adds a transient of the same shape,

    Z(k) = (R phi + A + B x + C x^2) R(k) + (D phi + E + F x) + V(k),    phi = 1/(1 + j (f - f_0)/(zeta f_0)),

x the relative distance from f_0. For a place f_0 and a damping ratio zeta all else follows by least squares. They are
scanned in steps of the least damping; where the mode explains much more than noise would, f_0 and zeta are fitted too.

Sources: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012, section
7.2 (local models); G. H. Golub and V. Pereyra, Inverse Problems 19 (2003) (separable least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import OptimizeResult, minimize

from amb_core.linear import Arrays, Complexes
from amb_core.robustness.local_response import LEAST_POWER, LocalResponse, Spectrum, spectrum_of, those_excited

LEAST_DAMPING = 1e-3  # damping ratio of the modes that are sought
REACH = 8.0  # half bandwidths to either side, from which lines are taken
FARTHEST = 0.128  # relative: where lines are taken at most, since a background is not quadratic over more
RESOLVED = 0.5  # half bandwidths per line, at least, of a mode that can be seen
_RATIOS = (1.0, 4.0, 16.0)  # damping ratios of the scan over the least one
_FREE = 2.0  # lines over unknowns, at least
_SIGNIFICANT = 10.0  # ratio of explained and unexplained power per unknown, from which a mode is taken as there
WIDEST = 0.05  # damping ratio from which the polynomials see a mode
_EXCITED = 1e-4  # of the largest line of an experiment, from which its references act at a frequency
_NOTHING = 1e-100  # norm of a column that says nothing
_STEP = 1.5  # of the scan, in half bandwidths
_POINTS = 33  # of the response at a mode
_NARROW_BAND = 0.4  # of the half bandwidth of a mode: bands whose parabolas follow it
_CUBIC = 0.15  # of the cubic term of a mode in a band, that its parabola may take for its middle
_FEWEST = 3  # values of such bands, that can contradict a fit
_CONTRADICTS = 4.0  # times their variance, from which their mean square difference does


@dataclass(frozen=True)
class SharpMode:
    """A narrow resonance.

    Attributes
    ----------
    frequency : float
        Where it is (Hz).
    damping : float
        Damping ratio.
    score : float
        Explained over unexplained power, per unknown.
    height : float
        Largest response of an output to a reference at its peak, without the background.
    """

    frequency: float
    damping: float
    score: float
    height: float = 0.0


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares at a place: coefficients by column, what is left of each signal, and how much of it is free."""

    columns: Complexes
    coefficients: Complexes
    covariance: Complexes
    left: Complexes
    free: int
    experiments: int

    @property
    def power(self) -> Arrays:
        return np.asarray(np.sum(np.abs(self.left) ** 2, axis=0))


def lowest_resolved(experiments: Sequence[tuple[Arrays, Arrays]], sample_time: float, damping: float) -> float:
    """Lowest frequency (Hz) at which the longest of some records resolves a mode of a damping ratio."""
    longest = max(len(references) for references, _ in _apart(experiments)) * sample_time
    return RESOLVED / (damping * longest)


def sharp_modes(
    experiments: Sequence[tuple[Arrays, Arrays]], sample_time: float, damping: float = LEAST_DAMPING
) -> list[SharpMode]:
    """Narrow resonances of signals, ascending in frequency.

    Parameters
    ----------
    experiments : sequence of (ndarray, ndarray)
        References, shape (steps, p), and signals, shape (steps, q), of each experiment.
    sample_time : float
        Sample time (s).
    damping : float
        Least damping ratio.
    """
    spectra = [spectrum_of(*item, sample_time) for item in _apart(experiments)]
    largest = np.max([np.mean(np.abs(r) ** 2, axis=0) for _, r, _ in spectra], axis=0)
    seen: list[SharpMode] = []
    for ratio in _RATIOS:
        zeta = damping * ratio
        low, high = lowest_resolved(experiments, sample_time, zeta), 0.49 / sample_time
        scanned = low * np.exp(_STEP * zeta * np.arange(int(np.log(high / low) / (_STEP * zeta))))
        scores = np.array([_score(spectra, float(at), zeta, largest) for at in scanned])
        inner = scores[1:-1]
        tops = np.flatnonzero((inner > _SIGNIFICANT) & (inner >= scores[:-2]) & (inner > scores[2:])) + 1
        seen += [SharpMode(float(scanned[top]), zeta, float(scores[top])) for top in tops]
    modes: list[SharpMode] = []
    for start in sorted(seen, key=lambda item: -item.score):
        if _is_known(start.frequency, modes, damping):
            continue
        mode = _fitted(spectra, start, damping, largest)
        if mode is not None and not _is_known(mode.frequency, modes, damping):
            modes.append(mode)
    return sorted(modes, key=lambda item: item.frequency)


def sharp_response(
    experiments: Sequence[tuple[Arrays, Arrays]], sample_time: float, mode: SharpMode
) -> LocalResponse | None:
    """The response around a mode, closely enough that its peak is among the values; None if the lines leave it open."""
    spectra = [spectrum_of(*item, sample_time) for item in _apart(experiments)]
    largest = np.max([np.mean(np.abs(r) ** 2, axis=0) for _, r, _ in spectra], axis=0)
    fit = _fit(spectra, mode.frequency, mode.damping, largest)
    if fit is None:
        return None
    reach = min(3.0 * mode.damping, FARTHEST) * np.linspace(-1.0, 1.0, _POINTS)
    references = spectra[0][1].shape[1]
    shape = np.stack([1.0 / (1.0 + 1j * reach / mode.damping), np.ones(_POINTS), reach, reach**2], axis=1)
    by_reference = np.zeros((_POINTS, references, len(fit.coefficients)), dtype=np.complex128)
    for reference in range(references):
        by_reference[:, reference, 4 * reference : 4 * reference + 4] = shape
    response = by_reference @ fit.coefficients
    noise = fit.left.T @ fit.left.conj() / fit.free
    spread = by_reference @ fit.covariance @ by_reference.conj().swapaxes(1, 2)
    signals = noise.shape[0]
    total = np.sum(np.abs(fit.left + fit.columns @ fit.coefficients) ** 2, axis=0)
    coherence = np.clip(1.0 - fit.power / np.maximum(total, np.finfo(float).tiny), 0.0, 1.0)
    return LocalResponse(
        mode.frequency * (1.0 + reach),
        np.asarray(response.swapaxes(1, 2)),
        np.broadcast_to(noise, (_POINTS, signals, signals)),
        np.asarray(spread),
        np.broadcast_to(coherence, (_POINTS, signals)),
        np.full(_POINTS, _reach(mode.damping) * mode.frequency),
    )


def _apart(experiments: Sequence[tuple[Arrays, Arrays]]) -> list[tuple[Arrays, Arrays]]:
    """Experiments in which one reference moves after the other, cut where the next one begins."""
    parts = []
    for references, signals in experiments:
        moving = [np.flatnonzero(column != column[0]) for column in references.T]
        spans = sorted((int(at[0]), int(at[-1])) for at in moving if len(at))
        in_turn = len(spans) > 1 and all(a[1] < b[0] for a, b in pairwise(spans))
        cuts = [0, *(span[0] for span in spans[1:]), len(references)] if in_turn else [0, len(references)]
        parts += [(references[a:b], signals[a:b]) for a, b in pairwise(cuts)]
    return parts


def with_sharp_peaks(
    wide: LocalResponse,
    experiments: Sequence[tuple[Arrays, Arrays]],
    sample_time: float,
    modes: Sequence[SharpMode],
) -> LocalResponse:
    """A response of wide bands, with that of narrow resonances in their places.

    A mode on a background is fitted over many of its bandwidths. A broad one has more than a background there, which
    bends the values: where the bands are narrow enough to see it and contradict them, theirs stay.
    """
    for mode in modes:
        near = sharp_response(experiments, sample_time, mode)
        if near is None or _is_contradicted(near, wide, mode):
            continue
        wide = wide.at((wide.frequency < near.frequency[0]) | (wide.frequency > near.frequency[-1])).joined(near)
    return wide


def _is_contradicted(near: LocalResponse, wide: LocalResponse, mode: SharpMode) -> bool:
    """Whether values of wide bands that see a mode differ from its own by more than their noise and their bias."""
    half_bandwidth = mode.damping * mode.frequency
    inside = (wide.frequency >= near.frequency[0]) & (wide.frequency <= near.frequency[-1])
    seen = wide.at(inside & (wide.half_band < _NARROW_BAND * half_bandwidth))
    if len(seen.frequency) < _FEWEST:
        return False
    height = np.abs(near.response - near.response.mean(axis=0)).max(axis=0)
    bent = _CUBIC * height * (seen.half_band[:, np.newaxis, np.newaxis] / half_bandwidth) ** 3
    noise, spread = (np.diagonal(part, axis1=1, axis2=2).real for part in (seen.noise, seen.spread))
    variance = noise[:, :, np.newaxis] * spread[:, np.newaxis, :]
    difference = np.abs(seen.response - CubicSpline(near.frequency, near.response)(seen.frequency)) ** 2
    return bool((difference / (variance + bent**2)).mean(axis=0).max() > _CONTRADICTS)


def hidden_height(
    experiments: Sequence[tuple[Arrays, Arrays]], sample_time: float, frequency: Arrays, damping: float
) -> Arrays:
    """How high a mode may be without being found, shape (f,): of the response of the outputs to the references.

    Parameters
    ----------
    experiments, sample_time
        As for `sharp_modes`; the last p signals are the outputs.
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    damping : float
        Damping ratio of the mode; infinite where the lines do not resolve it, or nothing is excited.
    """
    spectra = [spectrum_of(*item, sample_time) for item in _apart(experiments)]
    largest = np.max([np.mean(np.abs(r) ** 2, axis=0) for _, r, _ in spectra], axis=0)
    references = spectra[0][1].shape[1]
    heights = np.full(len(frequency), np.inf)
    for place, at in enumerate(frequency):
        fit = _fit(spectra, float(at), damping, largest)
        if fit is None or not damping * at * max(1.0 / (item[0][1] - item[0][0]) for item in spectra) >= RESOLVED:
            continue
        more = references + fit.experiments
        noise = fit.power[-references:].max() / fit.free
        variance = np.diagonal(fit.covariance).real[0 : 4 * references : 4].max()
        heights[place] = np.sqrt(_SIGNIFICANT * more * noise * variance)
    return heights


def _score(spectra: list[Spectrum], at: float, zeta: float, largest: Arrays) -> float:
    """How much more of the signals a mode explains than noise would."""
    lines = _lines(spectra, at, zeta, at, _reach(zeta), largest)
    if lines is None:
        return 0.0
    columns, modes, signals = lines
    order = np.r_[np.flatnonzero(~modes), np.flatnonzero(modes)]  # so that one factorisation serves both
    q = np.linalg.qr(columns[:, order] / np.linalg.norm(columns, axis=0)[order])[0]
    along = np.abs(q.conj().T @ signals) ** 2
    more, free = int(modes.sum()), len(columns) - columns.shape[1]
    left = np.sum(np.abs(signals) ** 2, axis=0) - along.sum(axis=0)
    gained = along[-more:].sum(axis=0) / more / (np.maximum(left, 0.0) / free + np.finfo(float).tiny)
    return float(np.max(gained))


def _is_known(frequency: float, modes: list[SharpMode], damping: float) -> bool:
    return any(abs(frequency / one.frequency - 1.0) < 4.0 * max(one.damping, damping) for one in modes)


def _fitted(spectra: list[Spectrum], start: SharpMode, damping: float, largest: Arrays) -> SharpMode | None:
    """Place and damping that leave the least; None for a mode that is too broad."""
    first = _fit(spectra, start.frequency, start.damping, largest)
    if first is None:
        return None
    scale = np.maximum(first.power, 1e-300)

    def left(unknown: Arrays) -> float:
        at = start.frequency * (1.0 + start.damping * unknown[0])
        fit = _fit(spectra, at, start.damping * float(np.exp(unknown[1])), largest, start)
        return 1e9 if fit is None else float(np.log(np.sum(fit.power / scale)))

    def give_up(intermediate_result: OptimizeResult) -> None:
        place, width = intermediate_result.x
        zeta = start.damping * np.exp(width)
        if abs(place) > REACH or not 0.1 * damping <= zeta <= 2.0 * WIDEST:  # outside the lines, or no such mode
            raise StopIteration

    best = minimize(
        left, [0.0, 0.0], method="Nelder-Mead", callback=give_up,
        options={"xatol": 1e-3, "fatol": 1e-6, "maxiter": 120},
    ).x  # fmt: skip
    at, zeta = start.frequency * (1.0 + start.damping * best[0]), start.damping * float(np.exp(best[1]))
    fit = _fit(spectra, at, zeta, largest)
    if fit is None or not 0.2 * damping <= zeta <= WIDEST or abs(best[0]) > 4.0:
        return None
    references = spectra[0][1].shape[1]
    height = float(np.abs(fit.coefficients[0 : 4 * references : 4, -references:]).max())
    return SharpMode(float(at), zeta, start.score, height)


def _fit(
    spectra: list[Spectrum], at: float, zeta: float, largest: Arrays, window: SharpMode | None = None
) -> _Fit | None:
    """Least squares at a place, by default from the lines about it; None if they do not determine it."""
    middle, reach = (at, _reach(zeta)) if window is None else (window.frequency, _reach(window.damping))
    lines = _lines(spectra, at, zeta, middle, reach, largest)
    if lines is None:
        return None
    columns, modes, signals = lines
    size = np.linalg.norm(columns, axis=0)
    count = int(modes.sum()) - spectra[0][1].shape[1]
    unit = columns / size
    inverse = np.linalg.pinv(unit.conj().T @ unit, rcond=1e-11, hermitian=True)
    coefficients = (inverse @ (unit.conj().T @ signals)) / size[:, np.newaxis]
    covariance = inverse / size[:, np.newaxis] / size
    return _Fit(
        columns, coefficients, covariance, signals - columns @ coefficients, len(columns) - columns.shape[1], count
    )


def _reach(zeta: float) -> float:
    """How far from a mode lines are taken, relative to its frequency."""
    return min(REACH * zeta, FARTHEST)


def _lines(
    spectra: list[Spectrum], at: float, zeta: float, middle: float, reach: float, largest: Arrays
) -> tuple[Complexes, NDArray[np.bool_], Complexes] | None:
    """Columns of the least squares, which of them are those of the mode, and the signals; None if they are too few."""
    references = spectra[0][1].shape[1]
    spectra = those_excited(spectra, middle, reach * middle)
    unknowns = 4 * references + 3 * len(spectra)
    density = sum(1.0 / (item[0][1] - item[0][0]) for item in spectra)  # lines per Hz
    half = max(reach * middle, 0.5 * _FREE * unknowns / density)
    if half > 0.5 * middle:
        return None
    rows: list[Complexes] = []
    wanted: list[Complexes] = []
    for number, (frequency, r, z) in enumerate(spectra):
        part = slice(*np.searchsorted(frequency, [middle - half, middle + half]))
        x = frequency[part] / at - 1.0
        shape = np.stack([1.0 / (1.0 + 1j * x / zeta), np.ones_like(x), x, x**2], axis=1)
        transient = np.zeros((len(x), 3 * len(spectra)), dtype=np.complex128)
        transient[:, 3 * number : 3 * number + 3] = shape[:, :3]
        rows.append(np.hstack([*(shape * r[part, one : one + 1] for one in range(references)), transient]))
        wanted.append(z[part])
    columns, signals = np.vstack(rows), np.vstack(wanted)
    power = np.max([_power(item, middle, half) for item in spectra], axis=0)
    acts = all(_power(item, middle, half).max() > _EXCITED * np.abs(item[1]).max() ** 2 for item in spectra)
    enough = len(columns) - columns.shape[1] >= max(signals.shape[1], 4)
    if (
        not enough
        or not acts
        or not np.all(power > LEAST_POWER * largest)
        or not np.all(np.linalg.norm(columns, axis=0) > _NOTHING)
    ):
        return None
    modes = np.r_[np.tile([True, False, False, False], references), np.tile([True, False, False], len(spectra))]
    return columns, modes, signals


def _power(item: Spectrum, middle: float, half: float) -> Arrays:
    """Mean power of the references of an experiment about a frequency."""
    part = slice(*np.searchsorted(item[0], [middle - half, middle + half]))
    lines = item[1][part]
    return np.asarray(np.mean(np.abs(lines) ** 2, axis=0) if len(lines) else np.zeros(item[1].shape[1]))
