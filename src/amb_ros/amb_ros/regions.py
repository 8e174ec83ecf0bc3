"""Regions as messages; `amb_core.recording.messages.region_state_from_message` is the way back."""

from __future__ import annotations

from dataclasses import fields

from amb_core.regions import AxisState, Onset, RegionState
from amb_msgs.msg import AxisRegion, RegionOnset
from amb_msgs.msg import RegionState as RegionStateMessage
from amb_ros.stamps import set_step_time

_FEATURES = [field.name for field in fields(AxisState) if field.name not in ("region", "since")]


def region_state_to_message(state: RegionState, run: int, sample_time: float) -> RegionStateMessage:
    """The message of a state in a run of this sample time (s)."""
    message = RegionStateMessage(
        run=run,
        step=state.step,
        region=int(state.region),
        since=_onset(state.since),
        radius=state.radius,
        settled=state.settled,
        x=_axis(state.x),
        y=_axis(state.y),
    )
    set_step_time(message.header.stamp, state.step, 1.0 / sample_time)
    return message


def _onset(onset: Onset) -> RegionOnset:
    return RegionOnset(
        step=onset.step, time=onset.time, input_frequency=onset.input_frequency, resonance=onset.resonance
    )


def _axis(axis: AxisState) -> AxisRegion:
    features = {name: getattr(axis, name) for name in _FEATURES}
    return AxisRegion(region=int(axis.region), since=_onset(axis.since), **features)
