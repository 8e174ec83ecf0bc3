"""Graph tests: nodes as processes of their own, talking over DDS in a domain of their own."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from domain_coordinator import domain_id
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from amb_core.excitation import Excitation
from amb_core.messages import block_from_message
from amb_core.records import LoopRecord
from amb_core.telemetry import merge_blocks
from amb_msgs.msg import LoopSamples, PlantState, SimulatorState
from amb_msgs.srv import Reset, RunSteps, StartExcitation
from amb_ros import middleware
from amb_ros.qos import HISTORY, LATCHED

# Here, since both hold for the first participant of the process and all after it.
middleware.configure()
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # tests on two machines of one network do not meet

TIMEOUT = 40.0  # s; for whatever takes a moment: start of a process, discovery, an answer, on a busy machine too


class Graph:
    """Processes under test, and nodes of the test itself, in one DDS domain.

    Nodes of the test spin in a thread: what they receive arrives while the test waits in `wait_until` or `call`.
    """

    def __init__(self, domain: int, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_LOG_DIR": str(folder / "log"),
            "ROS_PYTHON_CHECK_FIELDS": "1",
        }
        self._processes: list[subprocess.Popen[str]] = []
        self._modules: dict[str, subprocess.Popen[str]] = {}
        self._nodes: list[Node] = []
        self._clients: dict[str, Client] = {}
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._executor = EventsExecutor(context=self._context)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        self.node = self.add_node("graph_test")

    def start(
        self, module: str, *arguments: str, parameters: Mapping[str, Any] | None = None, **options: Any
    ) -> subprocess.Popen[str]:
        """Start the node of a module, such as `amb_ident_node.recorder`, as a process.

        `arguments` follow `--ros-args`; `options` go to Popen.
        """
        command = [sys.executable, "-m", module, "--ros-args", *arguments]
        if parameters:
            file = self.folder / f"parameters_{len(self._processes)}.yaml"
            file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}))
            command += ["--params-file", str(file)]
        self._modules[module] = self.start_command(command, **options)
        return self._modules[module]

    def start_command(self, command: list[str], **options: Any) -> subprocess.Popen[str]:
        """Start any program as a process of the graph; `options` go to Popen."""
        process = subprocess.Popen(
            command, env=self.environment, cwd=self.folder, stderr=subprocess.PIPE, text=True, **options
        )
        self._processes.append(process)
        return process

    def process_of(self, module: str) -> subprocess.Popen[str]:
        """The process in which a module was started last."""
        return self._modules[module]

    def stop(self, process: subprocess.Popen[str], by: signal.Signals = signal.SIGINT) -> tuple[int, str]:
        """End a process by a signal; its exit code and what it wrote to stderr."""
        process.send_signal(by)
        _, errors = process.communicate(timeout=TIMEOUT)
        return process.returncode, errors

    def add_node(self, name: str, namespace: str = "", **options: Any) -> Node:
        """A node of the test itself."""
        node = Node(name, namespace=namespace, context=self._context, **options)
        self._executor.add_node(node)
        self._nodes.append(node)
        return node

    def call(self, service_type: Any, name: str, /, **fields: Any) -> Any:
        """Call a service once it is there, with these fields in the request, and return its response."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        client = self._clients[name]
        self.wait_until(client.service_is_ready, what=f"service {name}")
        future = client.call_async(service_type.Request(**fields))
        self.wait_until(future.done, what=f"an answer of {name}")
        return future.result()

    def wait_until(
        self, condition: Callable[[], object], what: str = "the condition", timeout: float = TIMEOUT
    ) -> None:
        """Wait until a condition holds, and fail if it does not in time."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come within {timeout} s"
            time.sleep(0.005)

    def close(self) -> None:
        """End all processes and nodes."""
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._processes:
            try:
                process.communicate(timeout=TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
        self._context.try_shutdown()
        self._thread.join()
        self._executor.shutdown()  # lets go of the nodes, or those with an open request would outlive their end
        for node in self._nodes:  # or it would live on in the domain, and with it what it has published
            node.destroy_node()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while self._context.ok():
                self._executor.spin_once(timeout_sec=0.1)


class Bearing:
    """What a user of the loop sees: services, state, telemetry, states of the plant and diagnostics."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.states: list[SimulatorState] = []
        self.blocks: list[LoopSamples] = []
        self.plant_states: list[PlantState] = []
        self.diagnostics: list[tuple[float, DiagnosticStatus]] = []
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

    def run(self, steps: int) -> Any:
        self.graph.wait_until(self.telemetry.get_publisher_count, "the controller")
        answer = self.graph.call(RunSteps, "/amb/simulator/run", steps=steps)
        assert answer.success, answer.message
        return answer

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
        self.graph.wait_until(
            lambda: any(state.run == run and state.step >= step for state in self.states), f"step {step} of run {run}"
        )

    def wait_for_mode(self, mode: int) -> SimulatorState:
        self.graph.wait_until(lambda: self.states and self.states[-1].mode == mode, f"mode {mode}")
        return self.states[-1]

    def record(self, run: int, steps: int) -> LoopRecord:
        def mine() -> list[LoopSamples]:
            return [block for block in self.blocks if block.run == run]

        self.graph.wait_until(lambda: sum(len(block.position_x) for block in mine()) >= steps, "all telemetry")
        return merge_blocks([block_from_message(block) for block in mine()], 0, steps)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.diagnostics += [(time.monotonic(), status) for status in array.status]


_next_domain = itertools.cycle(range(1, 101)).__next__  # going on, so that no graph meets what one before it left


@contextlib.contextmanager
def _own_domain() -> Iterator[int]:
    with domain_id(_next_domain) as domain:
        yield domain


@contextlib.contextmanager
def _open_graph(folder: Path) -> Iterator[Graph]:
    with _own_domain() as domain:
        graph = Graph(domain, folder)
        try:
            yield graph
        finally:
            graph.close()


@pytest.fixture
def domain() -> Iterator[int]:
    """A DDS domain that no other test uses, in this run or in another on this machine."""
    with _own_domain() as domain:
        yield domain


@pytest.fixture(scope="session")
def own_domain() -> Callable[[], contextlib.AbstractContextManager[int]]:
    """Reserves such a domain, for fixtures that share one among tests."""
    return _own_domain


@pytest.fixture(scope="session")
def open_graph() -> Callable[[Path], contextlib.AbstractContextManager[Graph]]:
    """Opens a graph whose processes run in a folder, for fixtures that share one among tests."""
    return _open_graph


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A graph of its own for one test; its processes run in `tmp_path`."""
    with _open_graph(tmp_path) as graph:
        yield graph


@pytest.fixture(scope="session")
def watch_bearing() -> Callable[[Graph], Bearing]:
    """Makes the view of a user on the loop of a graph."""
    return Bearing


@pytest.fixture
def bearing(graph: Graph) -> Bearing:
    """The loop of the graph of one test."""
    return Bearing(graph)
