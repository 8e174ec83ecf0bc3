"""Faults of a recording: outliers, missing, repeated and frozen samples.

Where a law computes the currents exactly from the positions and references of the same record (`one_step`), one missing
row or one bad current breaks it; a bad position breaks the prediction of that position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.checks.one_step import OneStep, jumps_of, one_step
from amb_core.data.experiments.checks.plausible import is_coarse
from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.checks.samples import cut_samples
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment

_OUTLIER = 12.0  # standard deviations of the prediction error
_ABOVE_MOST = 5.0  # times the error that 98 % of the samples stay below
_OF_MOTION = 0.25  # of the signal's standard deviation: no rotor moves that far unpredictably within a sample
_BROKEN = 30.0  # standard deviations of the law's residual
_LEAST_BREAK = 1e-4  # of the current's standard deviation
_MOST_BROKEN = 0.3  # of the rows: beyond, another law holds
_REACH = 4  # samples around a bad one that it affects
_FROZEN = 20  # samples
_ALIVE = 0.3  # of its median change, that the signal of the same axis keeps while a signal is frozen
_FEW_VALUES = 16  # of a signal of discrete levels
_COARSE = 0.1  # share of equal neighbours of a quantised signal
_LONGER = 5  # times the next longest run, that a quantised signal must stay to be frozen
_OF_KICK = 2.0  # of the signal's standard deviation: what a jump of the reference cannot do within a sample
_MEDIAN = 1.4826  # standard deviation of Gaussian noise over its median magnitude
_OFTEN = 0.2  # share of the jumps of a reference that no fault of single rows spoils
_FEWEST_JUMPS = 8  # from which that share is known
_STALE = 5  # rows, that a repeated row lasts at most: a machine at rest repeats more
_FEWEST_STALE = 3
_DISTINCT = 0.01  # share of equal neighbours of a signal that is not quantised
_LISTED = 3

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class _Place:
    """Bad samples of a signal."""

    name: str
    experiment: int
    first: int  # steps of the run
    last: int

    def __str__(self) -> str:
        steps = f"step {self.first}" if self.first == self.last else f"steps {self.first} to {self.last}"
        return f"{self.name} {steps}" + (f" of experiment {self.experiment}" if self.experiment else "")


def check_faults(data: IdentificationData) -> list[Finding]:
    """The findings `frozen`, `repeated`, `outliers` and `missing`."""
    frozen: list[_Place] = []
    stale: list[_Place] = []
    bad: list[_Place] = []
    gone: list[_Place] = []
    sizes: list[str] = []
    for index, item in enumerate(data.experiments):
        if item.steps < 3 * _REACH or not np.isfinite(item.signals).all():
            continue
        spans, repeated = _frozen(item), _stale(item)
        frozen += [_Place(_names(data)[c], index, item.first_step + a, item.first_step + b) for c, a, b in spans]
        stale += [_Place("row", index, item.first_step + row, item.first_step + row) for row in repeated]
        spoilt = _limited(item)
        for _, first, last in spans:
            spoilt[max(first - _REACH, 0) : last + 1 + _REACH] = True
        for row in repeated:
            spoilt[max(row - 1, 0) : row + 1 + _REACH] = True
        fit = one_step(item, spoilt)
        if fit is None:
            continue
        for row in _missing(item, fit, spoilt):
            gone.append(_Place("before", index, item.first_step + row, item.first_step + row))
            spoilt[max(row - 1, 0) : row + 1 + _REACH] = True
        for column, row, size in _outliers(item, fit, spoilt):
            bad.append(_Place(_names(data)[column], index, item.first_step + row, item.first_step + row))
            unit = (*data.input_units, *data.output_units)[column]
            sizes.append(f"{size:.2g} {unit}".strip())
    return [_frozen_finding(frozen), _stale_finding(stale, data), _outlier_finding(bad, sizes), _missing_finding(gone)]


def frozen_positions(data: IdentificationData) -> list[str]:
    """Outputs that keep one value while an input of their axis moves, with the steps, as of a dead or stuck sensor."""
    inputs = len(data.input_names)
    return [
        str(_Place(data.output_names[column - inputs], index, item.first_step + first, item.first_step + last))
        for index, item in enumerate(data.experiments)
        if item.steps > _FROZEN and np.isfinite(item.signals).all()
        for column, first, last in _frozen(item)
        if column >= inputs
    ]


def _names(data: IdentificationData) -> tuple[str, ...]:
    return (*data.input_names, *data.output_names)


def _listed(places: list[_Place]) -> str:
    return ", ".join(map(str, places[:_LISTED])) + (f" and {len(places) - _LISTED} more" * (len(places) > _LISTED))


# -- frozen and repeated


def _runs(equal: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last sample of each run of equal samples; `equal[k]` is whether sample k + 1 equals sample k."""
    edges = np.diff(np.concatenate([[0], equal.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _frozen(item: Experiment) -> list[tuple[int, int, int]]:
    """Column, first and last sample of signals that keep one value while the other signal of their axis moves."""
    signals, stretches = np.hstack([item.inputs, item.outputs]), []
    m, p = item.inputs.shape[1], item.outputs.shape[1]
    change = np.abs(np.diff(signals, axis=0))
    usual = np.median(change, axis=0)
    for column in range(m + p):
        signal = signals[:, column]
        values = np.unique(signal)
        if column < m and len(values) <= _FEW_VALUES:
            continue
        partners = [c for c in range(m + p) if c != column] if m != p else [(column + m) % (m + p)]
        firsts, lasts = _runs(change[:, column] == 0.0)
        longest = np.sort(lasts - firsts)[-2:]
        if not len(longest) or longest[-1] < _FROZEN or is_coarse(signal):
            continue
        coarse = np.count_nonzero(change[:, column] == 0.0) - longest[-1] > _COARSE * item.steps
        for first, last in zip(firsts, lasts, strict=True):
            length = last - first
            if length < (max(_FROZEN, _LONGER * longest[0]) if coarse else _FROZEN):
                continue
            if signal[first] in (values[0], values[-1]) and len(values) > 1:
                continue  # at its extremes a signal is clipped
            moves = np.median(change[first:last, partners], axis=0)
            if np.any((moves > 0.0) & (moves >= _ALIVE * usual[partners])):
                stretches.append((column, int(first), int(last)))
    return stretches


def _stale(item: Experiment) -> list[int]:
    """Rows that repeat the one before in all signals, where the signals do not repeat themselves otherwise."""
    equal = np.diff(np.hstack([item.inputs, item.outputs]), axis=0) == 0.0
    every = equal.all(axis=1)
    if not every.any() or every.mean() > _MOST_BROKEN or equal[~every].mean(axis=0).min() > _DISTINCT:
        return []
    first, last = _runs(every)
    short = last - first <= _STALE
    rows = [int(row) + 1 for row in first[short]]
    return rows if len(rows) >= _FEWEST_STALE else []


# -- outliers and missing rows


def _limited(item: Experiment) -> NDArray[np.bool_]:
    """Rows with a signal at an extreme where it stays, and those after: there the law and the plant have a limit."""
    signals = np.hstack([item.inputs, item.outputs])
    rows = np.zeros(item.steps, bool)
    for signal in signals.T:
        rows |= cut_samples(signal)
    size = np.abs(item.inputs)  # a limit of the currents also shows in single samples, where a reference jumps
    at_top = size >= (1.0 - 1e-9) * size.max(axis=0)
    rows |= (at_top & (np.count_nonzero(at_top, axis=0) > 1)).any(axis=1)
    return _with_next(rows)


def _with_next(rows: NDArray[np.bool_] | np.bool_) -> NDArray[np.bool_]:
    """Rows, and those within reach after them."""
    known = np.asarray(rows)
    reached = known.copy()
    for lag in range(1, _REACH + 1):
        reached[lag:] |= known[:-lag]
    return reached


def _missing(item: Experiment, fit: OneStep, spoilt: NDArray[np.bool_]) -> list[int]:
    """Rows before which rows are missing: the law breaks on most axes, for as long as it looks back.

    A bad sample breaks it for one row more, and a bad current that no other row shows stands out of its neighbours.
    """
    broken = _broken(item, fit, spoilt)
    if not fit.exact or broken.any(axis=1).mean() > _MOST_BROKEN:
        return []
    rows = broken.sum(axis=1) > broken.shape[1] // 2
    if broken.shape[1] == 1:
        rows = rows & ~_with_next(_stands_out(item.inputs[:, 0]))
    return [
        int(group[0])
        for group in np.split(np.flatnonzero(rows), np.flatnonzero(np.diff(np.flatnonzero(rows)) > 1) + 1)
        if len(group) and (len(group) <= fit.lags or broken.shape[1] > 2)
    ]


def _outliers(item: Experiment, fit: OneStep, spoilt: NDArray[np.bool_]) -> list[tuple[int, int, float]]:
    """Column, sample and size of values that no neighbour explains; of values close together the first of the worst."""
    m, p = item.inputs.shape[1], item.outputs.shape[1]
    size = np.zeros((item.steps, m + p))
    size[:, m:] = np.where(spoilt[:, np.newaxis], 0.0, np.abs(fit.outputs))
    score = np.zeros_like(size)
    kicked = _kicked(item)
    for column in range(m, m + p):
        middle, most = np.quantile(size[:, column], [0.5, 0.98])
        spread = _spread(item.outputs[:, column - m])
        limit = max(_MEDIAN * _OUTLIER * middle, _ABOVE_MOST * most, _OF_MOTION * spread, np.finfo(float).tiny)
        score[:, column] = size[:, column] / np.where(kicked, np.maximum(limit, _OF_KICK * spread), limit)
    if fit.exact:
        broken = _broken(item, fit, spoilt)
        alone = broken & (broken.sum(axis=1) == 1)[:, np.newaxis]
        if broken.any(axis=1).mean() <= _MOST_BROKEN:
            for column in range(m):
                larger = item.inputs[:, column] * fit.laws[:, column] > 0.0
                is_bad = alone[:, column] & larger & _stands_out(item.inputs[:, column])
                size[is_bad, column] = np.abs(fit.laws[is_bad, column])
                score[is_bad, column] = 1.0 + 1e-9
    rows = np.flatnonzero((score > 1.0).any(axis=1))
    outliers = []
    for group in np.split(rows, np.flatnonzero(np.diff(rows) > _REACH) + 1):
        if len(group):
            column = int(np.argmax(score[group].max(axis=0)))
            row = int(group[np.argmax(score[group, column] > 1.0)])
            outliers.append((column, row, float(size[row, column])))
    return outliers


def _kicked(item: Experiment) -> NDArray[np.bool_]:
    """Rows soon after a jump of a reference, which the controller passes on to the rotor."""
    if item.reference is None:
        return np.zeros(item.steps, bool)
    step = np.diff(item.reference, axis=0, prepend=item.reference[:1])
    return _with_next(_with_next(jumps_of(step).any(axis=1)))


def _stands_out(signal: Arrays) -> NDArray[np.bool_]:
    """Samples far from both neighbours."""
    peak = np.zeros(len(signal))
    before, after = signal[1:-1] - signal[:-2], signal[1:-1] - signal[2:]
    peak[1:-1] = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    return np.asarray(peak > max(_ABOVE_MOST * float(np.quantile(peak, 0.98)), _OF_KICK * _spread(signal)))


def _spread(signal: Arrays) -> float:
    """Standard deviation of a signal, by quantiles."""
    low, high = np.quantile(signal, [0.16, 0.84])
    return 0.5 * float(high - low)


def _broken(item: Experiment, fit: OneStep, spoilt: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the law of each input does not hold."""
    limit = np.maximum(_BROKEN * fit.noise, _LEAST_BREAK * item.inputs.std(axis=0))
    size, breaks = np.abs(item.inputs), np.abs(fit.laws) > limit
    limited = breaks & (size >= (1.0 - 1e-9) * size.max(axis=0)) & (item.inputs * fit.laws < 0.0)  # no flat top
    without = spoilt | _with_next(limited.any(axis=1))
    if item.reference is not None:
        jumps = jumps_of(np.diff(item.reference, axis=0, prepend=item.reference[:1]))
        often = [(np.abs(fit.laws[rows]) > limit).mean(axis=0).max() for rows in jumps.T if rows.sum() >= _FEWEST_JUMPS]
        if max(often, default=0.0) > _OFTEN:  # these are no faults of single rows: the references are others
            without |= _with_next(jumps.any(axis=1))
    return np.asarray(breaks & ~without[:, np.newaxis])


# -- findings


def _frozen_finding(places: list[_Place]) -> Finding:
    if not places:
        return Finding("frozen", Severity.INFO, "no signal keeps a value while its axis moves")
    return Finding(
        "frozen", Severity.WARNING, "the recorded value stays the same while the axis moves", _listed(places),
        "leave these steps out (window), and check this sensor or channel",
    )  # fmt: skip


def _stale_finding(places: list[_Place], data: IdentificationData) -> Finding:
    if not places:
        return Finding("repeated", Severity.INFO, "no rows are repeated")
    return Finding(
        "repeated", Severity.WARNING,
        f"{len(places)} of {data.samples} rows repeat the one before in all signals, first at step {places[0].first}",
        _listed(places), "the recorder wrote old values: take new data, or leave these steps out (window)",
    )  # fmt: skip


def _outlier_finding(places: list[_Place], sizes: list[str]) -> Finding:
    if not places:
        return Finding("outliers", Severity.INFO, "no outliers")
    return Finding(
        "outliers", Severity.WARNING,
        f"{len(places)} value{'s' if len(places) > 1 else ''} that no neighbour explains, off by {sizes[0]}"
        + (" first" if len(places) > 1 else ""),
        _listed(places), "leave these steps out (window), or correct the values",
    )  # fmt: skip


def _missing_finding(places: list[_Place]) -> Finding:
    if not places:
        return Finding("missing", Severity.INFO, "no rows are missing, as far as the samples show")
    return Finding(
        "missing", Severity.WARNING,
        f"rows are missing at {len(places)} place{'s' if len(places) > 1 else ''}: there the currents do not follow "
        "from the positions of the row and the one before",
        _listed(places), "record step numbers or time stamps, and split the data there (--repair split)",
    )  # fmt: skip
