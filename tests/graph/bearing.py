"""The loop of a graph as a user sees it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.publisher import Publisher

from amb_core.excitation import Excitation
from amb_core.loop.machine import Machine as MachineDescription
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import merge_blocks
from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_core.recording.messages.machine import fill_machine
from amb_msgs.msg import LoopSamples, Machine, MachineAxis, MachineBearing, PlantState, SimulatorState
from amb_msgs.srv import Reset, RunSteps, StartExcitation
from amb_ros.qos import HISTORY, LATCHED

if TYPE_CHECKING:
    from tests.graph.conftest import Graph


def machine_message(machine: MachineDescription) -> Machine:
    """What a plant publishes on topic machine."""
    return fill_machine(Machine(), MachineAxis, MachineBearing, machine)


def machine_publisher(node: Node) -> Publisher:
    """A publisher of topic machine, in the plant's place."""
    return node.create_publisher(Machine, "/amb/machine", LATCHED)


class Bearing:
    """What a user of the loop sees: services, state, telemetry, states of the plant and diagnostics."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.states: list[SimulatorState] = []
        self.blocks: list[LoopSamples] = []
        self.plant_states: list[PlantState] = []
        self.diagnostics: list[DiagnosticStatus] = []
        node = graph.node
        node.create_subscription(SimulatorState, "/amb/simulator/state", self.states.append, LATCHED)
        self.telemetry = node.create_subscription(LoopSamples, "/amb/telemetry", self.blocks.append, HISTORY)
        self.plant_state_subscription = node.create_subscription(
            PlantState, "/amb/plant_state", self.plant_states.append, HISTORY
        )
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)

    def reset(self, parameter_file: str | Path = "") -> int:
        answer = self.graph.call(Reset, "/amb/simulator/reset", parameter_file=str(parameter_file))
        assert answer.success, answer.message
        return answer.run

    def run(self, steps: int, **fields: Any) -> Any:
        self.graph.wait_until(self.telemetry.get_publisher_count, "the controller")
        answer = self.graph.call(RunSteps, "/amb/simulator/run", steps=steps, **fields)
        assert answer.success, answer.message
        return answer

    def resets(self) -> bool:
        """Whether the simulator takes a reset."""
        return bool(self.graph.call(Reset, "/amb/simulator/reset").success)

    def excite(self, excitation: Excitation, run: int, first_step: int) -> None:
        answer = self.graph.call(
            StartExcitation,
            "/amb/excitation_generator/start",
            kind=excitation.kind,
            run=run,
            first_step=first_step,
            **excitation.model_dump(),
        )
        assert answer.success, answer.message
        assert (answer.run, answer.first_step) == (run, first_step)

    def wait_for_step(self, run: int, step: int) -> None:
        """Wait as long as the simulator's own clock goes on, however slowly."""
        while not any(state.run == run and state.step >= step for state in self.states):
            heard = len(self.states)
            self.graph.wait_until(lambda heard=heard: len(self.states) > heard, f"step {step} of run {run}")

    def wait_for_mode(self, mode: int) -> SimulatorState:
        self.graph.wait_until(lambda: self.states and self.states[-1].mode == mode, f"mode {mode}")
        return self.states[-1]

    def record(self, run: int, steps: int) -> LoopRecord:
        def mine() -> list[LoopSamples]:
            return [block for block in self.blocks if block.run == run]

        self.graph.wait_until(lambda: sum(map(steps_in, mine())) >= steps, "all telemetry")
        return merge_blocks([block_from_message(block) for block in mine()], 0, steps)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.diagnostics += array.status
