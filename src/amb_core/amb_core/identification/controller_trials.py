"""Laws that could have computed the currents of a record, each by least squares, and the simplest that fits.

Other gains, the other sign, the derivative of the other signal, currents of another axis, currents, positions or
references some samples earlier or later, another filter or sample time, a constant.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.control_law import LinearLaw, law_of
from amb_core.identification.controller_state import unexplained
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.records import LoopRecord

FOREIGN = 0.05
"""Part of the recorded currents, rms, that the controller of an experiment leaves unexplained at most."""
SAME_GAIN = 0.02
"""Relative difference of gains that is not worth a warning."""
SAMPLES = 10_000
"""Of a record that are compared."""
BETTER = 0.2
"""Of the remainder: what another law may leave to be named."""
TOPS = 3
"""Samples at the largest magnitude that make it a limit."""
_ALIKE = 2.0  # ratio of remainders up to which the simpler of two laws is taken
_SHIFTS = (0, 1, -1, 2, -2)  # samples
_RATES = (0.5, 2.0)  # times the sample rate of the data
_FILTERS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0)  # time constants of the derivative's filter (samples)
_WINDOW = 2_000  # of them for a law with a state, which is found from them
_BELOW = 0.99  # of the limit: measured currents stay a little below it
_GROWTH = 1e6  # largest growth of an unstable law over the window
_STILL = 1e-9  # of its size: a column that varies less is constant

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class Trial:
    """One law for all axes: what it leaves of the current of each axis, and how it differs from the one given."""

    left: Arrays  # (axes,)
    source: tuple[int, ...]  # axis whose law computes the current
    gains: Arrays  # (axes, gains): those of the law relative to the ones given
    offset: Arrays  # (axes,), A
    shift: int = 0
    other_derivative: bool = False
    filter_time: float = math.nan
    rate: float = 1.0
    position: tuple[int, ...] = ()  # axis whose position it uses; empty: its own
    reversed_position: tuple[bool, ...] = ()
    limits: tuple[float, ...] = ()  # where currents end that have another limit, A
    late_positions: tuple[int, ...] = ()  # samples by which each was recorded late, early if negative; empty: none
    late_references: tuple[int, ...] = ()  # likewise

    @property
    def worst(self) -> float:
        """The largest part of a current that is left (-)."""
        return float(self.left.max())


def liveliest(record: LoopRecord, samples: int) -> LoopRecord:
    """The part of a record in which its currents move most."""
    if record.steps <= samples:
        return record
    moved = np.sum((record.current - record.current.mean(axis=0)) ** 2, axis=1)
    power = np.concatenate([[0.0], np.cumsum(moved)])
    first = int(np.argmax(power[samples:] - power[:-samples]))
    return record.window(record.first_step + first, samples)


def given_shares(controller: KnownController, record: LoopRecord) -> Arrays:
    """Part of the current of each axis that the controller as it is leaves unexplained; NaN where it does not move."""
    if isinstance(controller, LinearControl):
        part = liveliest(record, _WINDOW)
        if np.abs(part.current).max() > 1.01 * controller.current_limit:
            unlimited = controller.parameters.model_copy(update={"current_limit": math.inf})
            controller = replace(controller, parameters=unlimited)
        return unexplained(controller, part)
    left = left_by_gains(controller, record)
    first = record.steps - len(left)
    return _share(left, record.current[first:], free_samples(record, controller.current_limit)[first:])


def constant_left(controller: KnownController, record: LoopRecord) -> Arrays:
    """The constant that a controller as it is leaves of the current of each axis (A), at its limit or not."""
    if isinstance(controller, LinearControl):
        trial = named(controller, record, float(np.nanmax(given_shares(controller, record))))
        return np.zeros(len(record.axes)) if trial is None else trial.offset
    return np.asarray(np.median(left_by_gains(controller, record), axis=0))


def left_by_gains(controller: ControllerParameters, record: LoopRecord) -> Arrays:
    """What the PD law without its limit leaves of the currents (A), shape (rows, axes).

    The rows are the last of the record, from the first for which the past of the derivative does not matter.

    Parameters
    ----------
    controller : ControllerParameters
        The law.
    record : LoopRecord
        References, positions and currents.
    """
    gains = pack_gains(controller, record.position.shape[1])
    error, derived, first = _pd_columns(record, gains[0, 2], gains[0, 3], controller.derivative_on == "error")
    return np.asarray(record.current[first:] - gains[:, 0] * error[first:] - gains[:, 1] * derived[first:])


def _share(left: Arrays, current: Arrays, free: NDArray[np.bool_]) -> Arrays:
    """Root mean square of what is left over that of the currents about their means, over the free samples."""
    shares = np.full(current.shape[1], np.nan)
    for axis in range(current.shape[1]):
        own = current[free[:, axis], axis]
        if len(own) > TOPS and (moved := float(own.std())) > 1e-9 * float(np.abs(own).max()):
            shares[axis] = float(np.sqrt(np.mean(left[free[:, axis], axis] ** 2))) / moved
    return shares


def free_samples(record: LoopRecord, limit: float) -> NDArray[np.bool_]:
    """Samples below the limit (A), whether it is the controller's or shows as a flat top; shape (steps, axes)."""
    size = np.abs(record.current)
    if size.max() > 1.01 * limit:  # the currents, or their units, are of another controller
        limit = math.inf
    top = size.max(axis=0) * (1.0 - 1e-9)
    flat = np.count_nonzero(size >= top, axis=0) >= TOPS
    return size < np.where(flat, np.minimum(top, _BELOW * limit), _BELOW * limit)


def _pd_columns(record: LoopRecord, keep: float, weight: float, on_error: bool) -> tuple[Arrays, Arrays, int]:
    """Position error, its filtered derivative, and the first sample for which the past does not matter."""
    from scipy.signal import lfilter  # takes half a second to import

    error = record.reference - record.position
    source = error if on_error else -record.position
    derived = lfilter([weight, -weight], [1.0, -keep], source - source[0], axis=0)
    first = 1 if keep == 0.0 else 1 + math.ceil(math.log(1e-9) / math.log(keep))
    return error, derived, min(first, len(error) // 2)


def named(controller: KnownController, record: LoopRecord, share: float) -> Trial | None:
    """The simplest law that leaves a fraction of what the given one leaves, and of the currents; None if none does."""
    least = BETTER * min(share, 1.0)  # gains near zero leave all of a current, which is less than wrong ones leave
    if isinstance(controller, LinearControl):
        trials = list(_linear_trials(controller, record))
    else:
        trials = [
            *_pd_trials(controller, record),
            *_rate_trials(controller, record),
            *_position_trials(controller, record),
        ]
        if min(trial.worst for trial in trials) > least:
            trials += _filtered_trials(controller, record)
    trials += _late_trials(controller, record)
    best = min(trial.worst for trial in trials)
    if best > least:
        return None
    alike = [trial for trial in trials if trial.worst <= max(_ALIKE * best, 1e-9)]
    return next((trial for trial in alike if trial.rate != 1.0), alike[0])


def _pd_trials(
    controller: ControllerParameters,
    record: LoopRecord,
    filter_time: float = math.nan,
    shifts: tuple[int, ...] = _SHIFTS,
) -> Iterator[Trial]:
    """PD laws of free gains: with the derivative of either signal, and the currents shifted, the likely ones first."""
    axes, sample_time = record.position.shape[1], record.sample_time
    gains = pack_gains(controller, axes)
    time = controller.derivative_filter if math.isnan(filter_time) else filter_time
    weight, given = 1.0 / (time + sample_time), controller.derivative_on == "error"
    free = free_samples(record, controller.current_limit)
    for shift, other in itertools.product(shifts, (False, True)):
        error, derived, first = _pd_columns(record, time * weight, weight, given != other)
        columns = [np.column_stack([error[:, axis], derived[:, axis]]) for axis in range(axes)]
        trial = _best_sources(record, columns, gains[:, :2], free, shift, first)
        yield replace(trial, other_derivative=other, filter_time=filter_time)


def _rate_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[Trial]:
    """The PD law of the same gains at another sample time than the data are said to have."""
    for rate in _RATES:
        other = replace(record, sample_time=record.sample_time / rate)
        trial = next(_pd_trials(controller, other, shifts=(0,)))
        if np.abs(trial.gains - 1.0).max() <= SAME_GAIN:
            yield replace(trial, rate=rate)


def _position_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[Trial]:
    """The PD law with positions of the other sign, or of another axis than the reference."""
    axes = range(record.position.shape[1])
    for other in (False, True):
        named: list[tuple[Trial, int, bool]] = []
        for axis in axes:
            best: tuple[Trial, int, bool] | None = None
            for source, sign in itertools.product(sorted(axes, key=lambda number: number != axis), (1.0, -1.0)):
                changed = record.position.copy()
                changed[:, axis] = sign * record.position[:, source]
                trial = _of_axis(controller, replace(record, position=changed), axis, other)
                if best is None or _ALIKE * trial.worst < best[0].worst:
                    best = trial, source, sign < 0.0
            assert best is not None
            named.append(best)
        trials, sources, reverse = zip(*named, strict=True)
        yield Trial(
            np.concatenate([trial.left for trial in trials]),
            tuple(axes),
            np.concatenate([trial.gains for trial in trials]),
            np.concatenate([trial.offset for trial in trials]),
            other_derivative=other,
            position=sources,
            reversed_position=reverse,
        )


def _of_axis(controller: ControllerParameters, record: LoopRecord, axis: int, other: bool) -> Trial:
    """The PD law of one axis with free gains."""
    gains = pack_gains(controller, record.position.shape[1])[[axis]]
    reference, position, current = (part[:, [axis]] for part in (record.reference, record.position, record.current))
    own = LoopRecord(record.first_step, record.sample_time, reference, position, current, record.axes[axis : axis + 1])
    on_error = (controller.derivative_on == "error") != other
    error, derived, first = _pd_columns(own, gains[0, 2], gains[0, 3], on_error)
    free = free_samples(own, controller.current_limit)
    return _best_sources(own, [np.hstack([error, derived])], gains[:, :2], free, 0, first)


def _filtered_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[Trial]:
    """PD laws with another filter of the derivative."""
    tried = [
        trial for samples in _FILTERS for trial in _pd_trials(controller, record, samples * record.sample_time, (0,))
    ]
    best = min(tried, key=lambda trial: trial.worst)
    step = 0.5 * record.sample_time
    for _ in range(8):  # halve the interval about the best
        near = [max(best.filter_time + sign * step, 0.0) for sign in (-1.0, 1.0)]
        tried = [trial for time in near for trial in _pd_trials(controller, record, time, (0,))]
        best = min([best, *tried], key=lambda trial: trial.worst)
        step *= 0.5
    yield best


def _linear_trials(controller: LinearControl, record: LoopRecord) -> Iterator[Trial]:
    """The given law with a factor, on other axes, with the currents shifted."""
    part = liveliest(record, _WINDOW)
    axes = part.position.shape[1]
    law = law_of(controller, axes)
    assert isinstance(law, LinearLaw)
    radius = float(np.abs(np.linalg.eigvals(law.a)).max(initial=0.0))
    count = part.steps if radius <= 1.0 else min(part.steps, int(math.log(_GROWTH) / math.log(radius)))
    count = max(count, min(part.steps, 4 * law.order + 8))
    part = replace(part, reference=part.reference[:count], position=part.position[:count], current=part.current[:count])
    inputs = law.inputs(part.reference, part.position)
    driven, forced, power = inputs @ law.b.T, np.zeros((count, law.order)), np.eye(law.order)
    shown = np.empty((count, axes, law.order))
    for step in range(count):
        shown[step] = law.c @ power
        power = law.a @ power
        if step + 1 < count:
            forced[step + 1] = law.a @ forced[step] + driven[step]
    output = forced @ law.c.T + inputs @ law.d.T + law.output_offset
    columns = [np.column_stack([output[:, axis], shown[:, axis]]) for axis in range(axes)]
    free = free_samples(part, controller.current_limit)
    for shift in _SHIFTS:
        yield _best_sources(part, columns, np.ones((axes, 1)), free, shift, 0)


def _late_trials(controller: KnownController, record: LoopRecord) -> Iterator[Trial]:
    """The law as given, of positions or references that were recorded late or early: those of all axes, or of one.

    Nothing is fitted: free gains would follow a shift that noise only suggests.
    """
    axes = len(record.axes)
    together, alone = np.ones(axes, dtype=int), np.eye(axes, dtype=int) if axes > 1 else ()
    same = tuple(range(axes)), np.ones((axes, 1)), np.zeros(axes)
    still = np.isnan(given_shares(controller, record))

    def left_by(changed: LoopRecord, ends: int) -> Arrays:
        left = given_shares(controller, changed.window(record.first_step + ends, record.steps - 2 * ends))
        return np.where(np.isnan(left), np.where(still, 0.0, math.inf), left)

    for late, who in itertools.product(_SHIFTS[1:], (together, *alone)):
        samples = tuple((late * who).tolist())
        position, reference = (_in_time(signal, samples) for signal in (record.position, record.reference))
        yield Trial(left_by(replace(record, position=position), abs(late)), *same, late_positions=samples)
        yield Trial(left_by(replace(record, reference=reference), abs(late)), *same, late_references=samples)


def _in_time(columns: Arrays, late: tuple[int, ...]) -> Arrays:
    """Columns moved by the samples by which each is late; the first and the last rows are of the other end."""
    return np.column_stack([np.roll(column, -samples) for column, samples in zip(columns.T, late, strict=True)])


def _best_sources(
    record: LoopRecord, columns: list[Arrays], given: Arrays, free: NDArray[np.bool_], shift: int, first: int
) -> Trial:
    """For each current the axis whose columns explain it best; its own if that does as well."""
    axes, gains_each = given.shape
    steps = record.steps
    rows = np.arange(max(first, first - shift), min(steps, steps - shift))  # of the columns
    left, source = np.full((axes, axes), np.inf), []
    gains, offset = np.zeros((axes, axes, gains_each)), np.zeros((axes, axes))
    for axis in range(axes):
        used = rows[free[rows + shift, axis]]
        current = record.current[used + shift, axis]
        mean = float(current.mean()) if len(used) else 0.0
        moved = float(current.std()) if len(used) else 0.0
        for other in range(axes):
            if len(used) <= columns[other].shape[1] + 1 or moved <= 1e-9 * max(abs(mean), 1e-12):
                left[axis, other] = 0.0
                gains[axis, other] = 1.0
                continue
            part = columns[other][used]
            centre, size = part.mean(axis=0), np.abs(part).max(axis=0)
            varied = np.abs(part - centre).max(axis=0)
            still = varied <= _STILL * size  # as the state of an integrator shows, which any constant is like
            scale = np.where(still, np.inf, varied)
            solution = np.linalg.lstsq((part - centre) / scale, current - mean, rcond=1e-13)[0] / scale
            rest = current - mean - (part - centre) @ solution
            left[axis, other] = float(np.sqrt(np.mean(rest**2))) / moved
            known = np.where(given[other] == 0.0, 1.0, given[other])
            gains[axis, other] = solution[:gains_each] / known
            constant = mean - float(centre @ solution)
            added = abs(constant) > FOREIGN * moved and not np.any(still & (size > 0.0))
            offset[axis, other] = constant if added else 0.0
        own = left[axis, axis] <= max(_ALIKE * left[axis].min(), 1e-9)
        source.append(axis if own else int(np.argmin(left[axis])))
    chosen = (range(axes), source)
    return Trial(left[chosen], tuple(source), gains[chosen], offset[chosen], shift)
