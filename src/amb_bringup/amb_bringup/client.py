"""`AmbClient`: the services of the graph as plain Python calls, with timeouts and clear errors.

with AmbClient() as amb:
    run = amb.reset()
    amb.start_excitation("square", amplitude=50e-6, duration=4.0, first_step=2000)
    amb.run(42_000)
    model = amb.identify(order=10)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from amb_core.errors import AmbError
from amb_core.identification import StateSpaceModel
from amb_core.messages import model_from_message
from amb_msgs.msg import SimulatorState
from amb_msgs.srv import (
    GetModel,
    Identify,
    Pause,
    Reset,
    RunSteps,
    StartExcitation,
    StartRecording,
    StopExcitation,
    StopRecording,
)
from amb_ros import topics
from amb_ros.qos import LATCHED

NODES = ("simulator", "pd_controller", "excitation_generator", "recorder", "identifier")


class ClientError(AmbError):
    """A node of the graph is missing, does not answer in time, or refuses a request."""


@dataclass(frozen=True)
class RunEnd:
    """Where a run request ended: run, next step, and whether the rotor delevitated before that step."""

    run: int
    step: int
    delevitated: bool


@dataclass(frozen=True)
class StartedExcitation:
    """An accepted excitation: its run, first step and number of steps."""

    run: int
    first_step: int
    steps: int


class AmbClient:
    """Calls the nodes of one graph. Not for use from several threads at once.

    Parameters
    ----------
    namespace : str
        Namespace of the nodes.
    timeout : float
        Longest wall-clock wait for a node to appear, to answer or, while running, to advance (s).
    domain_id : int, optional
        DDS domain of the graph; ROS_DOMAIN_ID by default.
    nodes : sequence of str
        The nodes of the graph, relative to the namespace.

    Attributes
    ----------
    node : Node
        The node behind the calls, for subscriptions of one's own; its callbacks run during calls and `wait_until`.

    Raises
    ------
    ClientError
        By every method, if a node is missing, does not answer within the timeout, or refuses; the message says what.
    """

    def __init__(
        self,
        namespace: str = topics.NAMESPACE,
        timeout: float = 20.0,
        domain_id: int | None = None,
        nodes: Sequence[str] = NODES,
    ) -> None:
        self.timeout = timeout
        self._nodes = tuple(nodes)
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = Node("amb_client", namespace=namespace, context=self._context, start_parameter_services=False)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}
        self._state: SimulatorState | None = None
        self._run = 0
        self.node.create_subscription(SimulatorState, topics.SIMULATOR_STATE, self._on_state, LATCHED)

    def __enter__(self) -> AmbClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self._context.try_shutdown()

    def wait_for_nodes(self) -> None:
        """Wait until all nodes of the graph are there."""
        for name in self._nodes:
            client = self.node.create_client(GetParameters, f"{name}/get_parameters")
            self.wait_until(client.service_is_ready, complaint=f"node {name} did not appear; is it running?")
            self.node.destroy_client(client)

    # -- simulator

    def reset(self, parameter_file: str | Path | None = None) -> int:
        """Back to step 0 of a new run, paused. Returns the number of the run.

        Parameters
        ----------
        parameter_file : str or Path, optional
            ROS parameter file with which the simulator goes on, as if it had been started with it. Relative to the
            working directory of the caller; the simulator must be able to read it.
        """
        path = "" if parameter_file is None else str(Path(parameter_file).absolute())
        self._run = self._call(Reset, "simulator/reset", parameter_file=path).run
        return self._run

    def pause(self) -> int:
        """Pause the simulator. Returns the next step."""
        return self._call(Pause, "simulator/pause").step

    def run(self, steps: int, progress: Callable[[int], None] | None = None) -> RunEnd:
        """Run a number of steps and wait for the end.

        Parameters
        ----------
        steps : int
            Number of controller steps, at least 1.
        progress : callable, optional
            Called with the next step whenever the simulator tells its state.
        """
        if steps < 1:
            raise ClientError(f"steps = {steps} is not allowed; allowed: 1 or more")
        started = self._call(RunSteps, "simulator/run", steps=steps)
        seen_step, deadline = -1, 0.0
        while True:
            state = self._state
            if state is not None and state.run == started.run:
                if state.step != seen_step:
                    seen_step, deadline = state.step, time.monotonic() + self.timeout
                    if progress is not None:
                        progress(state.step)
                if state.mode == SimulatorState.FAULT:
                    raise ClientError(
                        f"the plant failed at step {state.step}; see /diagnostics and the simulator's log"
                    )
                if state.mode == SimulatorState.DELEVITATED or state.step >= started.last_step:
                    return RunEnd(state.run, state.step, state.mode == SimulatorState.DELEVITATED)
                if state.mode == SimulatorState.PAUSED and state.step > started.first_step:
                    raise ClientError(f"the simulator was paused at step {state.step}, before {started.last_step}")
            if seen_step >= 0 and time.monotonic() > deadline:
                raise ClientError(
                    f"the loop has stood at step {seen_step} for {self.timeout:g} s; is pd_controller running?"
                )
            self._executor.spin_once(timeout_sec=0.1)

    # -- excitation

    def start_excitation(self, kind: str, first_step: int = -1, **settings: Any) -> StartedExcitation:
        """Start an excitation in the present run, from `first_step` on or, with -1, from the next step.

        `settings` are the fields of the kind in SI units, as in the service: amplitude, axes, duration, frequency, ...
        """
        known = StartExcitation.Request.get_fields_and_field_types()
        for name in settings:
            if name not in known:
                raise ClientError(f"unknown setting '{name}'; allowed: {', '.join(known)}")
        answer = self._call(
            StartExcitation, "excitation_generator/start", kind=kind, first_step=first_step, run=self._run, **settings
        )
        return StartedExcitation(answer.run, answer.first_step, answer.steps)

    def stop_excitation(self) -> None:
        """Stop the excitation: the reference returns to nominal."""
        self._call(StopExcitation, "excitation_generator/stop")

    # -- recording

    def start_recording(self, uri: str = "") -> str:
        """Start a bag in a folder that must not exist yet. Returns its path.

        Waits for all nodes of the graph first, so that the bag misses nothing of what they do.
        """
        self.wait_for_nodes()
        return self._call(StartRecording, "recorder/start", uri=uri).uri

    def stop_recording(self, run: int = 0, step: int = 0) -> str:
        """Close the bag, after the telemetry of this run up to (without) this step has come. Returns its path."""
        return self._call(
            StopRecording, "recorder/stop", wait_for_run=run, wait_for_step=step, timeout=0.5 * self.timeout
        ).uri

    # -- identification

    def identify(self, bag: str = "", order: int = 0, method: str = "", timeout: float = 300.0) -> StateSpaceModel:
        """Identify from the last experiment or from a bag; 0 and empty select the identifier's defaults."""
        answer = self._call(Identify, "identifier/identify", timeout=timeout, bag=bag, order=order, method=method)
        return model_from_message(answer.model)

    def get_model(self) -> StateSpaceModel:
        """The last identified model."""
        return model_from_message(self._call(GetModel, "identifier/get_model").model)

    def wait_until(
        self, condition: Callable[[], bool], timeout: float | None = None, complaint: str = "timed out"
    ) -> None:
        """Process messages until a condition holds; `complaint` is the error's text if it does not in time (s)."""
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while not condition():
            if time.monotonic() > deadline:
                raise ClientError(complaint)
            self._executor.spin_once(timeout_sec=0.05)

    # -- plumbing

    def _call(self, service: Any, name: str, /, *, timeout: float | None = None, **fields: Any) -> Any:
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service, name)
        client = self._clients[name]
        full_name = self.node.resolve_service_name(name)
        wait = self.timeout if timeout is None else timeout
        self.wait_until(client.service_is_ready, self.timeout, f"no service {full_name}; is the node running?")
        future = client.call_async(service.Request(**fields))
        self.wait_until(future.done, wait, f"no answer from {full_name} within {wait:g} s")
        answer = future.result()
        if not answer.success:
            raise ClientError(f"{full_name}: {answer.message}")
        return answer

    def _on_state(self, message: SimulatorState) -> None:
        self._state = message
        self._run = max(self._run, message.run)
