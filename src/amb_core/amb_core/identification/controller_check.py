"""Is this the controller of these currents? Asked before a fit: what the controller leaves unexplained, and what fits.

Positions, references and currents of a record are known, so a controller can be compared with the currents without any
model of the plant. Where they differ, other laws are tried (`controller_trials`). The simplest that leaves a fraction
of the remainder names the fault.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.controller_choice import with_shown_limit
from amb_core.data.experiments import Finding, IdentificationData, Severity
from amb_core.ground.errors import AmbError
from amb_core.identification.controller_limit import named_at_limit, shares_at_limit
from amb_core.identification.controller_trials import (
    FOREIGN,
    SAME_GAIN,
    SAMPLES,
    Trial,
    constant_left,
    given_shares,
    liveliest,
    named,
)
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.records import LoopRecord

NOT_CHECKED = "not checked"
"""With this begins a finding that says why nothing was compared."""
EXACT = 1e-3  # part of the currents, below which no other law is looked for

Arrays = NDArray[np.float64]
Difference = tuple[str, str]
"""What differs, and what to do."""


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
        `FOREIGN` of the currents is unexplained. The limit of a PD law is compared too, where it is known.
    """
    if controller is None:
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: no controller is known")
    controller = with_shown_limit(controller, data)
    finding = _below_limit(data, controller)
    if not _fits(finding) or isinstance(controller, LinearControl):
        return finding
    return _at_limit(data, controller) or finding


def added_constant(data: IdentificationData, controller: KnownController) -> NDArray[np.float64] | None:
    """The constant in the recorded currents that alone keeps them from being those of a controller.

    Parameters
    ----------
    data : IdentificationData
        The data; experiments without reference are left out.
    controller : KnownController
        The controller that the data are said to come from.

    Returns
    -------
    ndarray, shape (axes,), or None
        The constant of each current (A), the same in all experiments; None where there is none, or other differences.
    """
    if _below_limit(data, controller).severity is Severity.INFO:
        return None
    worst = _worst(data, with_shown_limit(controller, data))
    if isinstance(worst, str):
        return None
    constant = constant_left(controller, worst[2])
    without = tuple(replace(item, inputs=item.inputs - constant) for item in data.experiments)
    return constant if _fits(_below_limit(replace(data, experiments=without), controller)) else None


def _fits(finding: Finding) -> bool:
    """Whether currents were compared, and nothing is wrong with the controller."""
    return finding.severity is Severity.INFO and not finding.what.startswith(NOT_CHECKED)


def _below_limit(data: IdentificationData, controller: KnownController) -> Finding:
    """The finding from the samples below the limit."""
    controller = with_shown_limit(controller, data)
    worst = _worst(data, controller)
    if isinstance(worst, str):
        return Finding("controller", Severity.INFO, f"{NOT_CHECKED}: {worst}")
    share, index, record, shares = worst
    if share <= EXACT:
        return Finding("controller", Severity.INFO, "it computes the recorded currents from the recorded positions")
    return _difference(controller, record, share, _where(data, index, record, shares), data)


def _at_limit(data: IdentificationData, controller: ControllerParameters) -> Finding | None:
    """The finding from the samples at the limit, for a law that computes the others; None if it computes these too."""
    records = ((index, liveliest(data.record(index), SAMPLES)) for index in _with_reference(data))
    compared = [(index, record, shares_at_limit(controller, record)) for index, record in records if _finite(record)]
    index, record, shares = max(compared, key=lambda item: float(item[2].max()))
    share = float(shares.max())
    trial = named_at_limit(controller, record, shares) if share > 0.0 else None
    if trial is None and share <= FOREIGN:
        return None
    return _finding(controller, trial, share, _where(data, index, record, shares), data)


def _where(data: IdentificationData, index: int, record: LoopRecord, shares: NDArray[np.float64]) -> str:
    """The currents that are not explained, and the samples that were compared."""
    least = max(EXACT, 0.1 * float(np.nanmax(shares)))
    wrong = [name for name, value in zip(data.input_names, shares, strict=True) if value > least]
    span = f"steps {record.first_step} to {record.first_step + record.steps - 1} of experiment {index}"
    return f"{', '.join(wrong)}, {span}"


def _with_reference(data: IdentificationData) -> list[int]:
    return [index for index, item in enumerate(data.experiments) if item.reference is not None]


def _finite(record: LoopRecord) -> bool:
    return bool(np.isfinite(record.current).all() and np.isfinite(record.position).all())


def _worst(
    data: IdentificationData, controller: KnownController
) -> tuple[float, int, LoopRecord, NDArray[np.float64]] | str:
    """Part of the currents that is unexplained where it is largest, experiment, record and parts; or why not."""
    known = _with_reference(data)
    if not known:
        return "the data have no reference"
    compared = []
    for index in known:
        try:
            record = liveliest(data.record(index), SAMPLES)
        except AmbError as problem:
            return str(problem)
        if _finite(record):
            with np.errstate(over="ignore", invalid="ignore"):  # of a loop that diverged
                shares = given_shares(controller, record)
            if np.isfinite(shares).any():
                compared.append((float(np.nanmax(shares)), index, record, shares))
    if not compared:
        return "the currents do not move below their limit"
    return max(compared, key=lambda item: item[0])


def _difference(
    controller: KnownController, record: LoopRecord, share: float, where: str, data: IdentificationData
) -> Finding:
    """The finding for a controller that leaves a share of the currents below their limit unexplained."""
    return _finding(controller, named(controller, record, share), share, where, data)


def _finding(
    controller: KnownController, trial: Trial | None, share: float, where: str, data: IdentificationData
) -> Finding:
    """The finding for a controller that leaves a share of the currents unexplained, and the law that explains them."""
    what = f"the controller does not compute {100.0 * share:.2g} % (rms) of the recorded currents from the positions"
    differences = [] if trial is None else _differences(controller, trial, data)
    if trial is None or not differences:
        if share <= FOREIGN:
            return Finding("controller", Severity.INFO, what, where)
        return Finding(
            "controller", Severity.WARNING, what, where,
            "no other gains, sign, derivative, order of the axes or shift of a signal fits either: give the "
            "controller of this experiment, and signals that it received and returned",
        )  # fmt: skip
    left = f"but for {100.0 * trial.worst:.2g} % with {'; '.join(text for text, _ in differences)}"
    advice = "; ".join(dict.fromkeys(advice for _, advice in differences))
    return Finding("controller", Severity.WARNING, f"{what}, {left}", where, advice)


def _differences(controller: KnownController, trial: Trial, data: IdentificationData) -> list[Difference]:
    """What differs from the given law, each with what to do."""
    return [
        *_axis_differences(trial, data),
        *_time_differences(controller, trial),
        *_late_differences(trial, data),
        *_derivative_differences(controller, trial),
        *_limit_differences(controller, trial),
        *_gain_differences(controller, trial, data.input_names),
    ]


def _axis_differences(trial: Trial, data: IdentificationData) -> Iterator[Difference]:
    """Axes and positions that are swapped or reversed."""
    names, outputs = data.input_names, data.output_names
    for kind, sources, advice in (
        ("axes", trial.source, "name the columns in the order of the axes"),
        ("positions", trial.position, "name the positions in the order of the references"),
    ):
        swapped = [
            f"{name} computed from {outputs[source]}"
            for name, source, own in zip(names, sources, outputs, strict=False)
            if outputs[source] != own
        ]
        if swapped:
            yield f"{kind} swapped: {', '.join(swapped)}", advice
    wrong = [outputs[source] for source, back in zip(trial.position, trial.reversed_position, strict=False) if back]
    if wrong:
        text = ", ".join(wrong)
        yield f"the sign of the position {text} reversed", f"reverse the sign of {text}"


def _time_differences(controller: KnownController, trial: Trial) -> Iterator[Difference]:
    """Currents that are shifted, or another sample time."""
    if trial.shift:
        size, way = abs(trial.shift), "later" if trial.shift > 0 else "earlier"
        plural = "s" if size > 1 else ""
        yield (
            f"the currents {size} sample{plural} {way} than the positions",
            f"move the currents by {-trial.shift:+d} sample{plural}: the current of a step is the answer to its "
            "position",
        )
    if trial.rate != 1.0:
        time = 1e3 / (trial.rate * controller.sample_rate)
        yield f"a sample time of {time:g} ms", f"correct the sample time of the data to {time:g} ms"


def _late_differences(trial: Trial, data: IdentificationData) -> Iterator[Difference]:
    """Positions or references that were recorded beside the currents of other steps."""
    names = data.output_names
    for signal, late in (("position", trial.late_positions), ("reference", trial.late_references)):
        if not any(late):
            continue
        wrong = ", ".join(name for name, samples in zip(names, late, strict=True) if samples)
        samples = next(filter(None, late))
        size, way = abs(samples), "late" if samples > 0 else "early"
        plural = "s" if size > 1 else ""
        yield (
            f"the {signal}s {wrong} {size} sample{plural} {way}",
            f"move the {signal}s {wrong} by {-samples:+d} sample{plural}: the row of a step holds the {signal} from "
            "which its current was computed",
        )


def _derivative_differences(controller: KnownController, trial: Trial) -> Iterator[Difference]:
    """The derivative of the other signal, or another filter of it."""
    if trial.other_derivative:
        assert isinstance(controller, ControllerParameters)
        on = "measurement" if controller.derivative_on == "error" else "error"
        yield f"the derivative on the {on}", f"name the controller with derivative_on {on}: pd:K_P,K_D,{on}"
    if not math.isnan(trial.filter_time):
        yield (
            f"a derivative filter of {1e3 * trial.filter_time:.3g} ms",
            "name a parameter file with this derivative_filter",
        )


def _limit_differences(controller: KnownController, trial: Trial) -> Iterator[Difference]:
    """Another limit of the currents."""
    if trial.limits:
        ends = " and ".join(dict.fromkeys(f"{limit:.3g} A" for limit in trial.limits))
        yield (
            f"another limit: the currents end at {ends}, the controller's is {controller.current_limit:g} A",
            "give the controller with the current_limit of this experiment",
        )


def _gain_differences(controller: KnownController, trial: Trial, names: tuple[str, ...]) -> Iterator[Difference]:
    """The sign, other gains, or a constant."""
    gains = trial.gains
    signs = np.sign(gains).min(axis=1), np.sign(gains).max(axis=1)
    reversed_sign = signs[1] < 0.0
    if reversed_sign.any():
        wrong = ", ".join(name for name, is_wrong in zip(names, reversed_sign, strict=True) if is_wrong)
        yield f"the sign of {wrong} reversed", f"reverse the sign of {wrong}, or of the positions"
    gains = np.where(reversed_sign[:, np.newaxis], -gains, gains)
    other = np.abs(gains - 1.0).max(axis=1) > SAME_GAIN
    if other.any() and trial.worst <= FOREIGN:  # those of a law that explains less would be made up
        text = ", ".join(
            f"{name} {_gains_of(controller, len(names), trial.source[axis], gains[axis])}"
            for axis, name in enumerate(names)
            if other[axis]
        )
        yield f"other gains: {text}", "give these gains, or correct the units of the currents"
    if trial.offset.any():
        table = ", ".join(f"{name} {value:.3g} A" for name, value in zip(names, trial.offset, strict=True) if value)
        yield f"a constant added: {table}", "give the nominal reference, or take the constant out"


def _gains_of(controller: KnownController, axes: int, axis: int, factor: Arrays) -> str:
    """The gains of an axis that fit, in their units."""
    if isinstance(controller, LinearControl):
        return f"{factor[0]:.3g} times the controller's"
    given = pack_gains(controller, axes)[axis]
    return f"K_P {given[0] * factor[0]:.5g} A/m, K_D {given[1] * factor[1]:.4g} A s/m"
