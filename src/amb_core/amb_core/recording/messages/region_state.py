"""amb_msgs/RegionState: the region in which the machine runs, of this version or of 0.1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, TypeVar

from amb_core.recording.messages.time_stamp import set_step_time
from amb_core.regions import AxisState, BearingState, Onset, Region, RegionState

M = TypeVar("M", bound=Any)

_EVIDENCE = {"drift": "drifting", "oscillation": "oscillating"}
"""Onsets that an axis has or lacks, and the fields that say which."""
_FEATURES = [field for field in fields(AxisState) if field.name not in ("region", "since", *_EVIDENCE)]


def region_state_from_message(message: Any) -> RegionState:
    """The state of a RegionState message; its run remains in the message."""
    axes, bearings = _first_layout(message) if hasattr(message, "x") else _by_name(message)
    return RegionState(
        step=int(message.step),
        axes=axes,
        bearings=bearings,
        region=Region(message.region),
        since=_onset(message.since),
        radius=float(message.radius),
        settled=bool(message.settled),
    )


def fill_region_state(
    message: M, axis: Callable[[], Any], bearing: Callable[[], Any], state: RegionState, run: int, sample_time: float
) -> M:
    """Set the fields of a RegionState message to a state in a run of this sample time (s).

    `axis` and `bearing` make empty AxisRegion and BearingRegion messages.
    """
    message.run, message.step = run, state.step
    message.region, message.radius, message.settled = int(state.region), state.radius, state.settled
    _fill_onset(message.since, state.since)
    message.axes = [_filled_axis(axis(), part) for part in state.axes]
    message.bearings = [_filled_bearing(bearing(), part) for part in state.bearings]
    set_step_time(message.header.stamp, state.step, 1.0 / sample_time)
    return message


def _by_name(message: Any) -> tuple[tuple[AxisState, ...], tuple[BearingState, ...]]:
    """Axes and bearings."""
    bearings = (BearingState(str(part.name), Region(part.region), float(part.radius)) for part in message.bearings)
    return tuple(_axis_state(part) for part in message.axes), tuple(bearings)


def _first_layout(message: Any) -> tuple[tuple[AxisState, ...], tuple[BearingState, ...]]:
    """The same of a message of version 0.1, which has the axes x and y only, of one bearing without a name."""
    return (replace(_axis_state(message.x), name="x"), replace(_axis_state(message.y), name="y")), ()


def _axis_state(message: Any) -> AxisState:
    # bags of version 0.1 lack the fields that have a default
    features: dict[str, Any] = {field.name: getattr(message, field.name, field.default) for field in _FEATURES}
    evidence: dict[str, Any] = {
        name: _onset(getattr(message, name)) if getattr(message, flag, False) else None
        for name, flag in _EVIDENCE.items()
    }
    return AxisState(region=Region(message.region), since=_onset(message.since), **features, **evidence)


def _filled_bearing(message: M, state: BearingState) -> M:
    message.name, message.region, message.radius = state.name, int(state.region), state.radius
    return message


def _filled_axis(message: M, state: AxisState) -> M:
    message.region = int(state.region)
    _fill_onset(message.since, state.since)
    for field in _FEATURES:
        setattr(message, field.name, getattr(state, field.name))
    for name, flag in _EVIDENCE.items():
        onset = getattr(state, name)
        setattr(message, flag, onset is not None)
        if onset is not None:
            _fill_onset(getattr(message, name), onset)
    return message


def _onset(message: Any) -> Onset:
    return Onset(int(message.step), float(message.time), float(message.input_frequency), bool(message.resonance))


def _fill_onset(message: Any, onset: Onset) -> None:
    message.step, message.time = onset.step, onset.time
    message.input_frequency, message.resonance = onset.input_frequency, onset.resonance
