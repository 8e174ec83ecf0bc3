"""Whether a graph that is being started is ready: its nodes offer their services, and those of the loop are matched."""

from __future__ import annotations

import os

from amb_bringup.client import AmbClient
from amb_core.files.parameter_files import CONTROLLERS, nodes_with
from amb_msgs.msg import SimulatorState
from amb_ros import topics
from amb_sim_node.simulator import MODE_NAMES

OFFERED = {
    "simulator": ("reset", "run", "pause"),
    "excitation_generator": ("start", "stop", "preview"),
    "recorder": ("start", "stop"),
    "identifier": ("validate", "get_model"),
}
"""Services by node, besides those of its parameters, which every node has."""

CONTROLLER = "controller"
MATCHED = {
    topics.MACHINE: ("simulator", CONTROLLER),
    topics.POSITION: ("simulator", CONTROLLER),
    topics.CURRENT_REFERENCE: (CONTROLLER, "simulator"),
    topics.EXCITATION: ("excitation_generator", CONTROLLER),
    topics.TELEMETRY: (CONTROLLER, "region_monitor"),
}
"""Topics with their publishing and listening nodes: without these connections no experiment runs."""


class Readiness:
    """Monitors the start of a graph with one of the controllers, in the DDS domain of this process."""

    def __init__(self, controller: str = CONTROLLERS[0]) -> None:
        self._controller = controller
        self._nodes = nodes_with(controller)
        self._client = AmbClient(nodes=self._nodes)

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
        for topic, ends in MATCHED.items():
            publisher, listener = (self._controller if end == CONTROLLER else end for end in ends)
            if publisher not in {end.node_name for end in node.get_publishers_info_by_topic(f"{space}/{topic}")}:
                return f"{publisher} on {space}/{topic}"
            if listener not in {end.node_name for end in node.get_subscriptions_info_by_topic(f"{space}/{topic}")}:
                return f"{listener} on {space}/{topic}"
        return "" if self._client.simulator_state is not None else f"{space}/{topics.SIMULATOR_STATE}"

    def message(self) -> str:
        """Message once the graph is ready: the state, and a call that can be copied unchanged."""
        state = self._client.simulator_state
        if state is None:
            return ""
        text = f"ready: {len(self._nodes)} nodes; the simulator is {MODE_NAMES[state.mode]}"
        if state.mode != SimulatorState.PAUSED:
            return text
        return f"{text}. Run 10,000 steps (1 s) from another terminal:\n  {hint()}"


def hint() -> str:
    """A command for another terminal with the workspace sourced."""
    domain = os.environ.get("ROS_DOMAIN_ID")
    prefix = f"ROS_DOMAIN_ID={domain} " if domain else ""
    return f'{prefix}python3 -c "from amb_bringup.client import AmbClient; print(AmbClient().run(10_000))"'
