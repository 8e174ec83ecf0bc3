"""Messages about the state of a run, at the steps to which they belong: regions, and modes of simulator or bridge."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from amb_core.recording.content import SIMULATOR_STATE
from amb_core.recording.export.run_telemetry import RunTelemetry
from amb_core.recording.mcap_file import StoredTopic

BRIDGE_STATE = "amb_msgs/msg/BridgeState"
MODES = (SIMULATOR_STATE, BRIDGE_STATE)


class StateMessage(NamedTuple):
    """A message of a run, decoded and as stored, with its step and where it comes from."""

    step: int
    topic: StoredTopic
    message: Any
    data: bytes


def state_messages(telemetry: RunTelemetry, types: Collection[str]) -> Iterator[StateMessage]:
    """Messages of these types that belong to the run and its steps, in the order in which they were recorded."""
    first, stop = telemetry.spans[0][0], telemetry.spans[-1][1]
    for topic, data, message in telemetry.stored_messages(types):
        if int(message.run) == telemetry.run and first <= int(message.step) <= stop:
            yield StateMessage(int(message.step), topic, message, data)
