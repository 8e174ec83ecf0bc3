"""amb_msgs/RegionState: the region in which the bearing runs."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from amb_core.recording.messages.time_stamp import set_step_time
from amb_core.regions import AxisState, Onset, Region, RegionState

M = TypeVar("M", bound=Any)

REGION_STATE = "amb_msgs/msg/RegionState"
_EVIDENCE = {"drift": "drifting", "oscillation": "oscillating"}
"""Onsets that an axis has or lacks, and the fields that say which."""
_FEATURES = [field for field in fields(AxisState) if field.name not in ("region", "since", *_EVIDENCE)]


def region_state_from_message(message: Any) -> RegionState:
    """The state of a RegionState message; its run remains in the message."""
    return RegionState(
        step=int(message.step),
        x=_axis_state(message.x),
        y=_axis_state(message.y),
        region=Region(message.region),
        since=_onset(message.since),
        radius=float(message.radius),
        settled=bool(message.settled),
    )


def fill_region_state(message: M, state: RegionState, run: int, sample_time: float) -> M:
    """Set the fields of a RegionState message to a state in a run of this sample time (s)."""
    message.run, message.step = run, state.step
    message.region, message.radius, message.settled = int(state.region), state.radius, state.settled
    _fill_onset(message.since, state.since)
    _fill_axis(message.x, state.x)
    _fill_axis(message.y, state.y)
    set_step_time(message.header.stamp, state.step, 1.0 / sample_time)
    return message


def _axis_state(message: Any) -> AxisState:
    # bags of version 0.1 lack the fields that have a default
    features: dict[str, Any] = {field.name: getattr(message, field.name, field.default) for field in _FEATURES}
    evidence: dict[str, Any] = {
        name: _onset(getattr(message, name)) if getattr(message, flag, False) else None
        for name, flag in _EVIDENCE.items()
    }
    return AxisState(region=Region(message.region), since=_onset(message.since), **features, **evidence)


def _fill_axis(message: Any, state: AxisState) -> None:
    message.region = int(state.region)
    _fill_onset(message.since, state.since)
    for field in _FEATURES:
        setattr(message, field.name, getattr(state, field.name))
    for name, flag in _EVIDENCE.items():
        onset = getattr(state, name)
        setattr(message, flag, onset is not None)
        if onset is not None:
            _fill_onset(getattr(message, name), onset)


def _onset(message: Any) -> Onset:
    return Onset(int(message.step), float(message.time), float(message.input_frequency), bool(message.resonance))


def _fill_onset(message: Any, onset: Onset) -> None:
    message.step, message.time = onset.step, onset.time
    message.input_frequency, message.resonance = onset.input_frequency, onset.resonance
