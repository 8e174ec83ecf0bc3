"""Is this the controller of these currents? Asked before a fit: what the controller leaves unexplained, and what fits.

Positions, references and currents of a record are known, so a controller can be compared with the currents without any
model of the plant. Where they differ, other laws are tried by least squares: other gains, the other sign, the
derivative of the other signal, currents of another axis, currents some samples earlier or later, another filter or
sample time, a constant. The simplest that leaves a fraction of the remainder names the fault.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import Finding, IdentificationData, Severity
from amb_core.ground.errors import AmbError
from amb_core.identification.control_law import LinearLaw, law_of
from amb_core.identification.controller_state import unexplained
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.records import LoopRecord

FOREIGN = 0.05
"""Part of the recorded currents, rms, that the controller of an experiment leaves unexplained at most."""
NOT_CHECKED = "not checked"
"""With this begins a finding that says why nothing was compared."""
EXACT = 1e-3  # part of the currents, below which no other law is looked for
_BETTER = 0.2  # of the remainder: what another law may leave to be named
_ALIKE = 2.0  # ratio of remainders up to which the simpler of two laws is taken
_SAME_GAIN = 0.02  # relative difference of gains that is not worth a warning
_SHIFTS = (0, 1, -1, 2, -2)  # samples
_RATES = (0.5, 2.0)  # times the sample rate of the data
_FILTERS = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0)  # time constants of the derivative's filter (samples)
_SAMPLES = 10_000  # of a record that are compared
_WINDOW = 2_000  # of them for a law with a state, which is found from them
_BELOW = 0.99  # of the limit: measured currents stay a little below it
_TOPS = 3  # samples at the largest magnitude that make it a limit
_GROWTH = 1e6  # largest growth of an unstable law over the window

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class _Trial:
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

    @property
    def worst(self) -> float:
        return float(self.left.max())


def check_controller(data: IdentificationData, controller: KnownController | None) -> Finding:
    """Compare a controller with the recorded currents, and name what differs.

    Parameters
    ----------
    data : IdentificationData
        The data; experiments without reference are left out.
    controller : KnownController or None
        The controller that the data are said to come from.

    Returns
    -------
    Finding
        Of the check `controller`: a warning with the difference if another law fits far better, or if more than
        `FOREIGN` of the currents is unexplained.
    """
    if controller is None:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: no controller is known")
    known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
    if not known:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: the data have no reference")
    compared = []
    for index in known:
        try:
            record = _liveliest(data.record(index), _SAMPLES)
        except AmbError as problem:
            return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: {problem}")
        if np.isfinite(record.current).all() and np.isfinite(record.position).all():
            with np.errstate(over="ignore", invalid="ignore"):  # of a loop that diverged
                shares = _given(controller, record)
            if np.isfinite(shares).any():
                compared.append((float(np.nanmax(shares)), index, record, shares))
    if not compared:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: the currents do not move below their limit")
    share, index, record, shares = max(compared, key=lambda item: item[0])
    if share <= EXACT:
        return Finding("controller", Severity.INFO, "it computes the recorded currents from the recorded positions")
    wrong = [name for name, value in zip(data.input_names, shares, strict=True) if value > max(EXACT, 0.1 * share)]
    span = f"steps {record.first_step} to {record.first_step + record.steps - 1} of experiment {index}"
    return _difference(controller, record, share, f"{', '.join(wrong)}, {span}", data)


def _difference(
    controller: KnownController, record: LoopRecord, share: float, where: str, data: IdentificationData
) -> Finding:
    """The finding for a controller that leaves a share of the currents unexplained."""
    what = f"the controller does not compute {100.0 * share:.2g} % (rms) of the recorded currents from the positions"
    found = _named(controller, record, share)
    if found is None and share > FOREIGN:
        return Finding(
            "controller", Severity.WARNING, what, where,
            "no other gains, sign, derivative, order of the axes or shift of the currents fits either: give the "
            "controller of this experiment, and signals that it received and returned",
        )  # fmt: skip
    differences = [] if found is None else _differences(controller, found, data)
    if found is None or not differences:
        return Finding("controller", Severity.INFO, what, where)
    left = f"but for {100.0 * found.worst:.2g} % with {'; '.join(text for text, _ in differences)}"
    advice = "; ".join(dict.fromkeys(advice for _, advice in differences))
    return Finding("controller", Severity.WARNING, f"{what}, {left}", where, advice)


def _liveliest(record: LoopRecord, samples: int) -> LoopRecord:
    """The part of a record in which its currents move most."""
    if record.steps <= samples:
        return record
    moved = np.sum((record.current - record.current.mean(axis=0)) ** 2, axis=1)
    power = np.concatenate([[0.0], np.cumsum(moved)])
    first = int(np.argmax(power[samples:] - power[:-samples]))
    return record.window(record.first_step + first, samples)


def _given(controller: KnownController, record: LoopRecord) -> Arrays:
    """Part of the current of each axis that the controller as it is leaves unexplained; NaN where it does not move."""
    if isinstance(controller, LinearControl):
        part = _liveliest(record, _WINDOW)
        if np.abs(part.current).max() > 1.01 * controller.current_limit:
            unlimited = controller.parameters.model_copy(update={"current_limit": math.inf})
            controller = replace(controller, parameters=unlimited)
        return unexplained(controller, part)
    gains = pack_gains(controller, record.position.shape[1])
    error, derived, first = _pd_columns(record, gains[0, 2], gains[0, 3], controller.derivative_on == "error")
    left = record.current[first:] - gains[:, 0] * error[first:] - gains[:, 1] * derived[first:]
    return _share(left, record.current[first:], _free(record, controller.current_limit)[first:])


def _share(left: Arrays, current: Arrays, free: NDArray[np.bool_]) -> Arrays:
    """Root mean square of what is left over that of the currents about their means, over the free samples."""
    shares = np.full(current.shape[1], np.nan)
    for axis in range(current.shape[1]):
        own = current[free[:, axis], axis]
        if len(own) > _TOPS and (moved := float(own.std())) > 1e-9 * float(np.abs(own).max()):
            shares[axis] = float(np.sqrt(np.mean(left[free[:, axis], axis] ** 2))) / moved
    return shares


def _free(record: LoopRecord, limit: float) -> NDArray[np.bool_]:
    """Samples below the limit, whether it is the controller's or shows as a flat top."""
    size = np.abs(record.current)
    if size.max() > 1.01 * limit:  # the currents, or their units, are of another controller
        limit = math.inf
    top = size.max(axis=0) * (1.0 - 1e-9)
    flat = np.count_nonzero(size >= top, axis=0) >= _TOPS
    return size < np.where(flat, np.minimum(top, _BELOW * limit), _BELOW * limit)


def _pd_columns(record: LoopRecord, keep: float, weight: float, on_error: bool) -> tuple[Arrays, Arrays, int]:
    """Position error, its filtered derivative, and the first sample for which the past does not matter."""
    from scipy.signal import lfilter  # takes half a second to import

    error = record.reference - record.position
    source = error if on_error else -record.position
    derived = lfilter([weight, -weight], [1.0, -keep], source - source[0], axis=0)
    first = 1 if keep == 0.0 else 1 + math.ceil(math.log(1e-9) / math.log(keep))
    return error, derived, min(first, len(error) // 2)


def _named(controller: KnownController, record: LoopRecord, share: float) -> _Trial | None:
    """The simplest law that leaves a fraction of what the given one leaves; None if there is none."""
    if isinstance(controller, LinearControl):
        trials = list(_linear_trials(controller, record))
    else:
        trials = [
            *_pd_trials(controller, record),
            *_rate_trials(controller, record),
            *_position_trials(controller, record),
        ]
        if min(trial.worst for trial in trials) > _BETTER * share:
            trials += _filtered_trials(controller, record)
    best = min(trial.worst for trial in trials)
    if best > _BETTER * share:
        return None
    alike = [trial for trial in trials if trial.worst <= max(_ALIKE * best, 1e-9)]
    return next((trial for trial in alike if trial.rate != 1.0), alike[0])


def _pd_trials(
    controller: ControllerParameters,
    record: LoopRecord,
    filter_time: float = math.nan,
    shifts: tuple[int, ...] = _SHIFTS,
) -> Iterator[_Trial]:
    """PD laws of free gains: with the derivative of either signal, and the currents shifted, the likely ones first."""
    axes, sample_time = record.position.shape[1], record.sample_time
    gains = pack_gains(controller, axes)
    time = controller.derivative_filter if math.isnan(filter_time) else filter_time
    weight, given = 1.0 / (time + sample_time), controller.derivative_on == "error"
    free = _free(record, controller.current_limit)
    for shift, other in itertools.product(shifts, (False, True)):
        error, derived, first = _pd_columns(record, time * weight, weight, given != other)
        columns = [np.column_stack([error[:, axis], derived[:, axis]]) for axis in range(axes)]
        trial = _best_sources(record, columns, gains[:, :2], free, shift, first)
        yield replace(trial, other_derivative=other, filter_time=filter_time)


def _rate_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[_Trial]:
    """The PD law of the same gains at another sample time than the data are said to have."""
    for rate in _RATES:
        other = replace(record, sample_time=record.sample_time / rate)
        trial = next(_pd_trials(controller, other, shifts=(0,)))
        if np.abs(trial.gains - 1.0).max() <= _SAME_GAIN:
            yield replace(trial, rate=rate)


def _position_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[_Trial]:
    """The PD law with positions of the other sign, or of another axis than the reference."""
    axes = range(record.position.shape[1])
    for other in (False, True):
        named: list[tuple[_Trial, int, bool]] = []
        for axis in axes:
            best: tuple[_Trial, int, bool] | None = None
            for source, sign in itertools.product(sorted(axes, key=lambda number: number != axis), (1.0, -1.0)):
                changed = record.position.copy()
                changed[:, axis] = sign * record.position[:, source]
                trial = _of_axis(controller, replace(record, position=changed), axis, other)
                if best is None or _ALIKE * trial.worst < best[0].worst:
                    best = trial, source, sign < 0.0
            assert best is not None
            named.append(best)
        trials, sources, reverse = zip(*named, strict=True)
        yield _Trial(
            np.concatenate([trial.left for trial in trials]),
            tuple(axes),
            np.concatenate([trial.gains for trial in trials]),
            np.concatenate([trial.offset for trial in trials]),
            other_derivative=other,
            position=sources,
            reversed_position=reverse,
        )


def _of_axis(controller: ControllerParameters, record: LoopRecord, axis: int, other: bool) -> _Trial:
    """The PD law of one axis with free gains."""
    gains = pack_gains(controller, record.position.shape[1])[[axis]]
    reference, position, current = (part[:, [axis]] for part in (record.reference, record.position, record.current))
    own = LoopRecord(record.first_step, record.sample_time, reference, position, current, record.axes[axis : axis + 1])
    on_error = (controller.derivative_on == "error") != other
    error, derived, first = _pd_columns(own, gains[0, 2], gains[0, 3], on_error)
    free = _free(own, controller.current_limit)
    return _best_sources(own, [np.hstack([error, derived])], gains[:, :2], free, 0, first)


def _filtered_trials(controller: ControllerParameters, record: LoopRecord) -> Iterator[_Trial]:
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


def _linear_trials(controller: LinearControl, record: LoopRecord) -> Iterator[_Trial]:
    """The given law with a factor, on other axes, with the currents shifted."""
    part = _liveliest(record, _WINDOW)
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
    free = _free(part, controller.current_limit)
    for shift in _SHIFTS:
        yield _best_sources(part, columns, np.ones((axes, 1)), free, shift, 0)


def _best_sources(
    record: LoopRecord, columns: list[Arrays], given: Arrays, free: NDArray[np.bool_], shift: int, first: int
) -> _Trial:
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
            centre = part.mean(axis=0)
            scale = np.maximum(np.abs(part - centre).max(axis=0), np.finfo(float).tiny)
            solution = np.linalg.lstsq((part - centre) / scale, current - mean, rcond=1e-13)[0] / scale
            rest = current - mean - (part - centre) @ solution
            left[axis, other] = float(np.sqrt(np.mean(rest**2))) / moved
            known = np.where(given[other] == 0.0, 1.0, given[other])
            gains[axis, other] = solution[:gains_each] / known
            constant = mean - float(centre @ solution)
            offset[axis, other] = constant if abs(constant) > FOREIGN * moved else 0.0
        own = left[axis, axis] <= max(_ALIKE * left[axis].min(), 1e-9)
        source.append(axis if own else int(np.argmin(left[axis])))
    chosen = (range(axes), source)
    return _Trial(left[chosen], tuple(source), gains[chosen], offset[chosen], shift)


def _differences(controller: KnownController, found: _Trial, data: IdentificationData) -> list[tuple[str, str]]:
    """What differs from the given law, each with what to do."""
    names, outputs = data.input_names, data.output_names
    differences = []
    swapped = [(name, outputs[source]) for name, source, own in zip(names, found.source, outputs, strict=True)
               if outputs[source] != own]  # fmt: skip
    if swapped:
        table = ", ".join(f"{name} computed from {source}" for name, source in swapped)
        differences.append((f"axes swapped: {table}", "name the columns in the order of the axes"))
    moved = [(name, outputs[source]) for name, source, own in zip(names, found.position, outputs, strict=False)
             if outputs[source] != own]  # fmt: skip
    if moved:
        table = ", ".join(f"{name} computed from {source}" for name, source in moved)
        differences.append((f"positions swapped: {table}", "name the positions in the order of the references"))
    wrong = [outputs[source] for source, back in zip(found.position, found.reversed_position, strict=False) if back]
    if wrong:
        text = ", ".join(wrong)
        differences.append((f"the sign of the position {text} reversed", f"reverse the sign of {text}"))
    if found.shift:
        size, way = abs(found.shift), "later" if found.shift > 0 else "earlier"
        plural = "s" if size > 1 else ""
        differences.append(
            (
                f"the currents {size} sample{plural} {way} than the positions",
                f"move the currents by {-found.shift:+d} sample{plural}: the current of a step is the answer to its "
                "position",
            )
        )
    if found.rate != 1.0:
        time = 1e3 / (found.rate * controller.sample_rate)
        differences.append((f"a sample time of {time:g} ms", f"correct the sample time of the data to {time:g} ms"))
    if found.other_derivative:
        assert isinstance(controller, ControllerParameters)
        on = "measurement" if controller.derivative_on == "error" else "error"
        differences.append(
            (f"the derivative on the {on}", f"name the controller with derivative_on {on}: pd:K_P,K_D,{on}")
        )
    if not math.isnan(found.filter_time):
        differences.append(
            (
                f"a derivative filter of {1e3 * found.filter_time:.3g} ms",
                "name a parameter file with this derivative_filter",
            )
        )
    return differences + _gain_differences(controller, found, names)


def _gain_differences(controller: KnownController, found: _Trial, names: tuple[str, ...]) -> list[tuple[str, str]]:
    gains = found.gains
    signs = np.sign(gains).min(axis=1), np.sign(gains).max(axis=1)
    reversed_sign = signs[1] < 0.0
    differences = []
    if reversed_sign.any():
        wrong = ", ".join(name for name, is_wrong in zip(names, reversed_sign, strict=True) if is_wrong)
        differences.append((f"the sign of {wrong} reversed", f"reverse the sign of {wrong}, or of the positions"))
    gains = np.where(reversed_sign[:, np.newaxis], -gains, gains)
    other = np.abs(gains - 1.0).max(axis=1) > _SAME_GAIN
    if other.any():
        text = ", ".join(
            f"{name} {_gains_of(controller, len(names), found.source[axis], gains[axis])}"
            for axis, name in enumerate(names)
            if other[axis]
        )
        differences.append((f"other gains: {text}", "give these gains, or correct the units of the currents"))
    if found.offset.any():
        table = ", ".join(f"{name} {value:.3g} A" for name, value in zip(names, found.offset, strict=True) if value)
        differences.append((f"a constant added: {table}", "give the nominal reference, or take the constant out"))
    return differences


def _gains_of(controller: KnownController, axes: int, axis: int, factor: Arrays) -> str:
    """The gains of an axis that fit, in their units."""
    if isinstance(controller, LinearControl):
        return f"{factor[0]:.3g} times the controller's"
    given = pack_gains(controller, axes)[axis]
    return f"K_P {given[0] * factor[0]:.5g} A/m, K_D {given[1] * factor[1]:.4g} A s/m"
