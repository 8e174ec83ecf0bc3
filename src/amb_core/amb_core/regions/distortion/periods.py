"""Periodic parts of a recording, and the realisations of one kind of signal among them, from its reference alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.records import LoopRecord
from amb_core.regions.distortion.measurement import PeriodicResponse
from amb_core.regions.distortion.records import moving
from amb_core.regions.distortion.signals import Lines

SETTLING = 0.1
"""Time after which transients of a bearing's loop have decayed (s)."""
FEWEST_LINES = 8
"""Excited lines of a multisine; a signal of fewer has no response over frequency."""
EXCITED = 1e-3
"""Amplitude of an excited line, relative to the largest one."""
_FEWEST_STEPS = 4 * FEWEST_LINES  # of a period
_SAME = 1e-6  # difference of reference samples a period apart, relative to their range
_CORRELATED = 0.05  # autocorrelation, above which a peak may be a period
_MOST_CANDIDATES = 40
_AS_GOOD = 0.99  # part of the longest periodic time that a shorter period must reach
_FEWEST_MOVES = 16  # that are repeated: chance repeats few of random steps, such as 4 of 0.01 s each
_MOST_MOVES = 0.5  # part of all moves, that those with fewer must have together, as of some periods of squares
_REPEATED = 0.999  # correlation of two realisations that are one and the same, shifted or with the opposite sign

Signal = NDArray[np.float64]


@dataclass(frozen=True)
class PeriodicPart:
    """Consecutive whole periods: the index of the record, the first sample in it, and their number."""

    record: int
    start: int
    periods: int


def find_periodic_parts(references: Sequence[Signal]) -> tuple[int, list[PeriodicPart]]:
    """The period (samples) with which references repeat for the longest time, and all parts of two periods or more.

    The shortest period is taken, not a multiple of it. Without any the period is 0.

    Parameters
    ----------
    references : sequence of ndarray, shape (steps, axes)
        References of the records (m).
    """
    longest, best = 0, (0, list[PeriodicPart]())
    searched = [_Searched.of(item) for item in references]
    for period in sorted({candidate for item in references for candidate in _candidates(item)}):
        parts = _periodic_parts(searched, period)
        steps = period * sum(part.periods for part in parts)
        if _AS_GOOD * steps > longest:
            longest, best = steps, (period, parts)
    return best


def periodic_parts(references: Sequence[Signal], period: int) -> list[PeriodicPart]:
    """All parts of two periods or more of references with a known period (samples), but those by chance."""
    return _periodic_parts([_Searched.of(item) for item in references], period)


@dataclass(frozen=True)
class _Searched:
    """A reference, the difference of samples that are the same (m), and whether it moves from each to the next."""

    reference: Signal
    tolerance: float
    moves: NDArray[np.bool_]

    @classmethod
    def of(cls, reference: Signal) -> _Searched:
        tolerance = _SAME * _range(reference)
        return cls(reference, tolerance, np.any(np.abs(np.diff(reference, axis=0)) > tolerance, axis=1))


def _range(reference: Signal) -> float:
    """Largest range of a column (m); NumPy is slow along the columns of a narrow array."""
    return max((float(np.ptp(column)) for column in reference.T if len(column)), default=0.0)


def _periodic_parts(searched: Sequence[_Searched], period: int) -> list[PeriodicPart]:
    parts = [part for index, item in enumerate(searched) for part in _parts(index, item, period)]
    inside = [searched[part.record].moves[part.start : part.start + part.periods * period] for part in parts]
    of_all = sum(np.count_nonzero(item.moves) for item in searched)
    of_parts = sum(np.count_nonzero(item) for item in inside)
    if of_parts >= _MOST_MOVES * of_all:
        return parts
    return [part for part, item in zip(parts, inside, strict=True) if np.count_nonzero(item[period:]) >= _FEWEST_MOVES]


def settled_responses(
    records: Sequence[LoopRecord], period: int, parts: Sequence[PeriodicPart]
) -> list[PeriodicResponse]:
    """The parts without their first periods, in which transients decay, as long as two periods remain.

    With two periods alone a transient is in one of them. It then counts as noise, and not as distortion.
    """
    responses = []
    for part in parts:
        wanted = -(-round(SETTLING / records[part.record].sample_time) // period)
        left_out = min(wanted, part.periods - 2)
        record, start = records[part.record], part.start + left_out * period
        stop = part.start + part.periods * period
        shape = (part.periods - left_out, period, len(record.axes))
        responses.append(
            PeriodicResponse(
                record.reference[start : start + period],
                record.current[start:stop].reshape(shape),
                record.position[start:stop].reshape(shape),
            )
        )
    return responses


def without_repetitions(responses: Sequence[PeriodicResponse]) -> list[PeriodicResponse]:
    """One response of each realisation: the same one again, even later or with the opposite sign, shows nothing new."""
    kept: list[PeriodicResponse] = []
    spectra: list[NDArray[np.complex128]] = []
    for item in responses:
        spectrum = np.fft.rfft(item.reference - item.reference.mean(axis=0), axis=0)
        spectrum /= np.sqrt(np.sum(np.fft.irfft(spectrum, len(item.reference), axis=0) ** 2))
        correlations = (np.fft.irfft((spectrum * other.conj()).sum(axis=1), len(item.reference)) for other in spectra)
        if all(np.max(np.abs(correlation)) < _REPEATED for correlation in correlations):
            kept.append(item)
            spectra.append(spectrum)
    return kept


def excited_lines(responses: Sequence[PeriodicResponse]) -> Lines:
    """Lines that the references of some experiments excite, and the others up to the highest of these."""
    period = len(responses[0].reference)
    strength = np.max([np.abs(np.fft.rfft(item.reference, axis=0)) for item in responses], axis=(0, 2))
    strength[0] = 0.0
    excited = np.flatnonzero(strength > EXCITED * strength.max())
    unexcited = np.setdiff1d(np.arange(1, excited[-1] + 2), excited)
    unexcited = unexcited[unexcited < (period + 1) // 2]
    return Lines(period, excited, unexcited[unexcited % 2 == 1], unexcited[unexcited % 2 == 0])


def _candidates(reference: Signal) -> list[int]:
    """Lags at which the reference may repeat: the highest peaks of its autocorrelation."""
    steps = len(reference)
    if steps < 2 * _FEWEST_STEPS or not np.isfinite(reference).all() or not moving(reference).any():
        return []
    centred = reference - reference.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(centred, 2 * steps, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum.sum(axis=1))[: steps // 2 + 2]
    inner = correlation[1:-1]
    peak = (inner > correlation[:-2]) & (inner >= correlation[2:]) & (inner > _CORRELATED * correlation[0])
    lags = np.flatnonzero(peak) + 1
    lags = lags[lags >= _FEWEST_STEPS]
    return [int(lag) for lag in lags[np.argsort(-correlation[lags], kind="stable")][:_MOST_CANDIDATES]]


def _parts(index: int, searched: _Searched, period: int) -> list[PeriodicPart]:
    """Parts of a reference of two whole periods or more in which it moves."""
    reference, tolerance = searched.reference, searched.tolerance
    if len(reference) < 2 * period:
        return []
    same = np.all(np.abs(reference[period:] - reference[:-period]) <= tolerance, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]]))).reshape(-1, 2)
    parts = []
    for start, stop in edges:
        periods = int(stop - start) // period + 1
        if periods >= 2 and _range(reference[start : start + period]) > tolerance:
            parts.append(PeriodicPart(index, int(start), periods))
    return parts
