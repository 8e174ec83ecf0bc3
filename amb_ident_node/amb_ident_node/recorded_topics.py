"""The topics of a recorder, how the workbench publishes them, and where in a run their messages belong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage

from amb_core.recording.messages.loop_samples import steps_in
from amb_ident_node.completeness import Mark
from amb_msgs.msg import (
    BridgeState,
    Excitation,
    ExcitationStatus,
    LoopSamples,
    Machine,
    PlantState,
    RegionMap,
    RegionState,
    SimulatorState,
    StateSpaceModel,
    Trip,
)
from amb_ros import topics
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED, STREAM

PARAMETER_EVENTS, ROSOUT, DIAGNOSTICS = "/parameter_events", "/rosout", "/diagnostics"
LAST_STEP = 2**64 - 1
REGION_MESSAGES = "region messages"
"""Key of the monitor's diagnostics for the number of its messages; a recorder compares it with its own count."""


class RecordedTopic(NamedTuple):
    """A topic to record.

    Attributes
    ----------
    name : str
        Relative to the namespace, or absolute.
    type : type
        Its message.
    offered : QoSProfile
        Quality of service with which the nodes of the workbench publish it.
    """

    name: str
    type: Any
    offered: QoSProfile

    @property
    def type_name(self) -> str:
        """As `package/msg/Name`."""
        return f"{self.type.__module__.split('.')[0]}/msg/{self.type.__name__}"

    @property
    def latched(self) -> bool:
        """Whether its last message is a state that every bag needs, regardless of its age."""
        return self.offered in (LATCHED, EVERY_STATE)

    @property
    def keeps_history(self) -> bool:
        """Whether the workbench publishes it with history."""
        return self.offered.durability == DurabilityPolicy.TRANSIENT_LOCAL

    @property
    def requested(self) -> QoSProfile:
        """As offered, with a longer queue for bursts."""
        return EVERY_STATE if self.latched else self.offered


RECORDED = (
    RecordedTopic(topics.MACHINE, Machine, LATCHED),
    RecordedTopic(topics.CONTROLLER, StateSpaceModel, LATCHED),
    RecordedTopic(topics.TELEMETRY, LoopSamples, HISTORY),
    RecordedTopic(topics.PLANT_STATE, PlantState, HISTORY),
    RecordedTopic(topics.EXCITATION, Excitation, LATCHED),
    RecordedTopic(topics.EXCITATION_STATUS, ExcitationStatus, EVERY_STATE),
    RecordedTopic(topics.REGION, RegionState, HISTORY),
    RecordedTopic(topics.REGION_MAP, RegionMap, LATCHED),
    RecordedTopic(topics.MODEL, StateSpaceModel, LATCHED),
    RecordedTopic(topics.SIMULATOR_STATE, SimulatorState, EVERY_STATE),
    RecordedTopic(topics.BRIDGE_STATE, BridgeState, LATCHED),
    RecordedTopic(topics.TRIP, Trip, EVERY_STATE),
    RecordedTopic(topics.CLOCK, ClockMessage, STREAM),
    RecordedTopic(PARAMETER_EVENTS, ParameterEvent, STREAM),
    RecordedTopic(ROSOUT, Log, STREAM),
    RecordedTopic(DIAGNOSTICS, DiagnosticArray, STREAM),
)
OF_THE_GRAPH = (topics.TELEMETRY, topics.PLANT_STATE, topics.REGION, topics.SIMULATOR_STATE, topics.CLOCK)
"""Topics that follow the steps of a run: everything published up to an awaited step must have arrived."""
OF_A_RUN = (*OF_THE_GRAPH, topics.BRIDGE_STATE)
"""Topics of the nodes without which a run does not go on, or is not recorded whole."""


def monitor_progress(values: Mapping[str, str]) -> tuple[int, int, int] | None:
    """Run, next step and number of messages that diagnostics of a region monitor report; None for all others."""
    counts = [_count(values.get(key, "")) for key in ("run", "next step", REGION_MESSAGES)]
    run, next_step, messages = counts
    return None if run is None or next_step is None or messages is None else (run, next_step, messages)


def _count(text: str) -> int | None:
    """The count in a text; None if it holds none that a message could carry."""
    if not (text.isascii() and text.isdecimal() and len(text) <= len(str(LAST_STEP))):
        return None
    return int(text) if int(text) <= LAST_STEP else None


def end_of(message: Any) -> Mark | None:
    """Run and step at which a message ends; None if that does not decide whether it belongs to a recording."""
    if isinstance(message, LoopSamples):
        return Mark(message.run, message.first_step + steps_in(message))
    if isinstance(message, PlantState | SimulatorState):
        return Mark(message.run, message.step + 1)
    if isinstance(message, RegionState):
        return Mark(message.run, message.next_step)
    if isinstance(message, Excitation) and not message.run:  # meant for the present run
        return None
    if isinstance(message, BridgeState | Excitation | ExcitationStatus | Trip):
        return Mark(message.run, LAST_STEP)
    return None
