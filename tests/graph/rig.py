"""A rig as a user sees it: an emulated target and the hardware bridge as processes."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from amb_core.excitation import Excitation
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import merge_blocks
from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_msgs.msg import BridgeState, LoopSamples, Trip
from amb_msgs.srv import StartExcitation
from amb_ros.qos import EVERY_STATE, HISTORY
from tests.graph.processes import NodeProcess

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

EMULATOR, BRIDGE = "amb_sim_node.target_emulator", "amb_sim_node.hardware_bridge"
UNHURRIED = {
    "port": 0,
    "real_time_factor": 0.3,
    "limits.missed_steps": 1e9,
    "plant_waits": True,
    "ideal": True,
    "limits.host_time": 1e3,
}
"""An emulator that any machine keeps up with, and that waits for its host."""
PATIENT = {"timeout": 30.0, "silence": 20.0}
"""A link (s) that takes no process of a loaded machine, which waits for its turn, for one that has gone."""


def free_port() -> int:
    """A UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def unhurried_file(folder: Path) -> Path:
    """A parameter file for an emulator on a port of its own that any machine keeps up with, and its bridge."""
    port = free_port()
    parameters = {
        "target_emulator": UNHURRIED | {"port": port},
        "hardware_bridge": {"link.port": port} | {f"link.{name}": value for name, value in PATIENT.items()},
    }
    path = folder / "unhurried.yaml"
    path.write_text(yaml.safe_dump({f"/amb/{node}": {"ros__parameters": it} for node, it in parameters.items()}))
    return path


class Rig:
    """Emulator and bridge, with what they publish; without an emulator if the bridge has a link of another kind."""

    def __init__(
        self,
        graph: Graph,
        *arguments: str,
        emulator: dict[str, Any] | None = None,
        bridge: dict[str, Any] | None = None,
        kind: str = "amb_udp",
    ) -> None:
        self.graph = graph
        self.states: list[BridgeState] = []
        self.trips: list[Trip] = []
        self.blocks: list[LoopSamples] = []
        self.statuses: list[DiagnosticStatus] = []
        node = graph.node
        node.create_subscription(BridgeState, "/amb/hardware_bridge/state", self.states.append, EVERY_STATE)
        node.create_subscription(Trip, "/amb/trip", self.trips.append, EVERY_STATE)
        node.create_subscription(LoopSamples, "/amb/telemetry", self.blocks.append, HISTORY)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self._bridge = {"link.kind": kind}
        if kind == "amb_udp":
            self.emulator: NodeProcess = graph.start(EMULATOR, *arguments, parameters=UNHURRIED | (emulator or {}))
            graph.wait_until(lambda: "UDP port" in self.values("target_emulator"), "the emulator")
            self._bridge["link.port"] = int(self.values("target_emulator")["UDP port"])
        self._bridge |= {
            "link.float64": True,
            "levitation_time": 0.0,
            "landing_time": 0.0,
        }
        self._bridge |= {f"link.{name}": value for name, value in PATIENT.items()} | (bridge or {})
        self._arguments = arguments
        self.start_bridge()

    def start_bridge(self) -> None:
        self.states.clear()
        self.bridge: NodeProcess = self.graph.start(BRIDGE, *self._arguments, parameters=self._bridge)
        self.graph.wait_until(lambda: self.states, "the bridge")

    def change(self, label: str = "", number: int = 0) -> bool:
        return self.asked(label, number)()

    def asked(self, label: str = "", number: int = 0) -> Callable[[], bool]:
        """Ask for a transition; what is returned waits for whether it has succeeded."""
        transition = Transition(label=label, id=number)
        answer = self.graph.asked(ChangeState, "/amb/hardware_bridge/change_state", transition=transition)
        return lambda: bool(answer().success)

    @property
    def life_cycle(self) -> str:
        return str(self.graph.call(GetState, "/amb/hardware_bridge/get_state").current_state.label)

    @property
    def state(self) -> BridgeState:
        return self.states[-1]

    def levitate(self) -> int:
        """Configure and activate; the run that begins."""
        before = self.state.run
        assert self.change("configure"), self.state.problem
        assert self.change("activate"), self.state.problem
        self.graph.wait_until(lambda: self.state.run > before, "the run")
        return int(self.state.run)

    def set(self, node: str, **values: Any) -> None:
        assert self.refusals(node, **values) == []

    def refusals(self, node: str, **values: Any) -> list[str]:
        """Why a node does not take parameters; empty if it does."""
        parameters = [
            Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()
        ]
        answer = self.graph.call(SetParameters, f"/amb/{node}/set_parameters", parameters=parameters)
        return [result.reason for result in answer.results if not result.successful]

    def reset_faults(self) -> None:
        answer = self.graph.call(Trigger, "/amb/hardware_bridge/reset_faults")
        assert answer.success, answer.message

    def excite(self, excitation: Excitation, first_step: int = -1) -> Any:
        return self.graph.call(
            StartExcitation,
            "/amb/excitation_generator/start",
            kind=excitation.kind,
            run=self.state.run,
            first_step=first_step,
            **excitation.model_dump(),
        )

    def wait_for_step(self, step: int) -> None:
        """Wait as long as the target's own clock goes on, however slowly."""
        while (now := self.state.step) < step:
            self.graph.wait_until(lambda now=now: self.state.step != now, f"a step after {now}, on the way to {step}")

    def record(self, run: int, steps: int) -> LoopRecord:
        def mine() -> list[LoopSamples]:
            return [block for block in self.blocks if block.run == run]

        self.graph.wait_until(lambda: sum(map(steps_in, mine())) >= steps, "all telemetry")
        return merge_blocks([block_from_message(block) for block in mine()], 0, steps)

    def values(self, node: str) -> dict[str, str]:
        """The latest diagnostics of a node."""
        mine = self.health(node)
        return {item.key: item.value for item in mine[-1].values} if mine else {}

    def health(self, node: str) -> list[DiagnosticStatus]:
        """All diagnostics of a node."""
        return [status for status in self.statuses if status.name == f"amb/{node}"]

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += array.status


def config(name: str) -> Path:
    """A parameter file of the workbench."""
    return Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / f"{name}.yaml"
