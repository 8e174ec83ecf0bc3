"""Whether a graph that is being started is ready: its nodes offer their services, and those of the loop are matched."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from amb_bringup.client import AmbClient
from amb_bringup.client.rig import MODES
from amb_core.ground.files.parameter_files import BRIDGE_NODE, CONTROLLERS, RIG_NODES, nodes_with
from amb_msgs.msg import SimulatorState
from amb_ros import topics
from amb_ros.simulator_modes import MODE_NAMES

OFFERED = {
    "simulator": ("reset", "run", "pause"),
    BRIDGE_NODE: ("get_state", "change_state", "reset_faults", "off"),
    "excitation_generator": ("start", "stop", "preview"),
    "recorder": ("start", "stop"),
    "identifier": ("validate", "get_model"),
}
"""Services by node, besides those of its parameters, which every node has."""


class Readiness(ABC):
    """Monitors the start of a graph, in the DDS domain of this process.

    Parameters
    ----------
    nodes : sequence of str
        The nodes of the graph.
    matched : mapping
        Topics with their publishing and listening nodes: without these connections no experiment runs.
    """

    def __init__(self, nodes: Sequence[str], matched: Mapping[str, tuple[str, str]]) -> None:
        self._nodes, self._matched = nodes, matched
        self._client = AmbClient(nodes=nodes)

    def close(self) -> None:
        """Leave the graph."""
        self._client.close()

    def missing(self, wait: float) -> str:
        """What is still missing, empty once the graph is ready.

        Parameters
        ----------
        wait : float
            Longest time to wait for messages (s).
        """
        self._client.spin_once(wait)
        node = self._client.node
        services = {name for name, _ in node.get_service_names_and_types()}
        space = node.get_namespace()
        for name in self._nodes:
            for service in ("get_parameters", *OFFERED.get(name, ())):
                if f"{space}/{name}/{service}" not in services:
                    return f"{space}/{name}/{service}"
        for topic, (publisher, listener) in self._matched.items():
            if publisher not in {end.node_name for end in node.get_publishers_info_by_topic(f"{space}/{topic}")}:
                return f"{publisher} on {space}/{topic}"
            if listener not in {end.node_name for end in node.get_subscriptions_info_by_topic(f"{space}/{topic}")}:
                return f"{listener} on {space}/{topic}"
        return "" if self._state() else f"{space}/{self._state_topic}"

    def message(self) -> str:
        """Message once the graph is ready: the state, and a call that can be copied unchanged."""
        return f"ready: {len(self._nodes)} nodes; {self._state()}"

    _state_topic: str

    @abstractmethod
    def _state(self) -> str:
        """The state of the plant's side and what to call next; empty before it is known."""


class LoopReadiness(Readiness):
    """Monitors the start of a graph with a simulator and one of the controllers."""

    _state_topic = topics.SIMULATOR_STATE

    def __init__(self, controller: str = CONTROLLERS[0]) -> None:
        matched = {
            topics.MACHINE: ("simulator", controller),
            topics.POSITION: ("simulator", controller),
            topics.CURRENT_REFERENCE: (controller, "simulator"),
            topics.EXCITATION: ("excitation_generator", controller),
            topics.TELEMETRY: (controller, "region_monitor"),
        }
        super().__init__(nodes_with(controller), matched)

    def _state(self) -> str:
        state = self._client.simulator_state
        if state is None:
            return ""
        text = f"the simulator is {MODE_NAMES[state.mode]}"
        if state.mode != SimulatorState.PAUSED:
            return text
        call = "from amb_bringup.client import AmbClient; print(AmbClient().run(10_000))"
        return f"{text}. Run 10,000 steps (1 s) from another terminal:\n  {in_domain(f'python3 -c {call!r}')}"


class RigReadiness(Readiness):
    """Monitors the start of a graph with a bridge to a rig; that the target answers is shown by connecting to it."""

    _state_topic = topics.BRIDGE_STATE

    def __init__(self) -> None:
        matched = {
            topics.MACHINE: (BRIDGE_NODE, "region_monitor"),
            topics.EXCITATION: ("excitation_generator", BRIDGE_NODE),
            topics.TELEMETRY: (BRIDGE_NODE, "region_monitor"),
        }
        super().__init__(RIG_NODES, matched)
        self._rig = self._client.rig

    def _state(self) -> str:
        state = self._rig.state
        if state is None:
            return ""
        if state.sample_time:
            return f"the target is {MODES[state.mode]}"
        return (
            "not connected to the target yet. Connect, then levitate, from another terminal:\n"
            f"  {in_domain('amb rig connect')}\n  {in_domain('amb rig levitate')}"
        )


def in_domain(command: str) -> str:
    """A command for another terminal with the workspace sourced."""
    domain = os.environ.get("ROS_DOMAIN_ID")
    return f"ROS_DOMAIN_ID={domain} {command}" if domain else command
