"""An identifier under test: records that it hears as if a controller sent them, and calls of its services."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_msgs.action import Identify as IdentifyAction
from amb_msgs.msg import AxisSamples, ExcitationStatus, LoopSamples, StateSpaceModel
from amb_msgs.srv import Certify, GetModel, Identify, Validate
from amb_ros.qos import HISTORY, LATCHED

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

IDENTIFIER = "amb_ident_node.identifier"
BLOCK = 100
STEPS = 6_000
FIRST_STEP = 1_000  # of the excitation
SAMPLE_TIME = 1e-4
PAPER = "paper"  # nobody runs a pd_controller beside most of these identifiers


def linear_loop(steps: int, seed: int = 1) -> LoopRecord:
    """The linearised bearing (two unstable real poles per axis of 230 1/s) under square waves, with PD controller."""
    controller = PdController(ControllerParameters())
    stiffness, gain = 3.3e5 / 6.25, 66.0 / 6.25  # k_s / m (1/s^2), k_i / m (m/(A s^2))
    rate = np.sqrt(stiffness)
    cosh, sinh = np.cosh(rate * SAMPLE_TIME), np.sinh(rate * SAMPLE_TIME)
    a = np.array([[cosh, sinh / rate], [rate * sinh, cosh]])
    b = gain * np.array([(cosh - 1.0) / stiffness, sinh / rate])
    rng = np.random.default_rng(seed)
    reference = np.zeros((steps, 2))
    reference[FIRST_STEP:] = 2e-5 * np.sign(rng.normal(size=((steps - FIRST_STEP) // 50, 2))).repeat(50, axis=0)
    position, current = np.empty((steps, 2)), np.empty((steps, 2))
    noise = 1e-9 * rng.normal(size=(steps, 2))
    state = np.zeros((2, 2))
    for step in range(steps):
        position[step] = state[0] + noise[step]
        current[step] = controller.update(position[step], reference[step])
        state = a @ state + np.outer(b, current[step])
    return LoopRecord(0, SAMPLE_TIME, reference, position, current)


class Loop:
    """An identifier, and records that it hears as if a controller sent them, each as a run of its own."""

    def __init__(self, graph: Graph, parameter_timeout: float = 0.1) -> None:
        self.graph = graph
        self.telemetry = graph.node.create_publisher(LoopSamples, "/amb/telemetry", HISTORY)
        self.status = graph.node.create_publisher(ExcitationStatus, "/amb/excitation_status", LATCHED)
        graph.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.process = graph.start(IDENTIFIER, parameters={"parameter_timeout": parameter_timeout})
        self.action = ActionClient(graph.node, IdentifyAction, "/amb/identifier/identify")
        graph.wait_until(lambda: self.telemetry.get_subscription_count(), "the identifier")
        graph.wait_until(lambda: self.status.get_subscription_count(), "the identifier")
        self._runs = itertools.count(1)
        self.heard: LoopRecord | None = None  # last
        self._heard: tuple[str, str] | None = None  # run and step after the last, as the identifier reports them

    def publish(self, record: LoopRecord, skip: tuple[int, ...] = (), block: int = BLOCK) -> int:
        """Publish a record; returns its run once the identifier has heard all of it."""
        run = next(self._runs)
        excited = record.steps - FIRST_STEP
        self.status.publish(
            ExcitationStatus(run=run, id=1, kind="square", accepted=True, first_step=FIRST_STEP, steps=excited)
        )
        for first in range(0, record.steps, block):
            if first in skip:
                continue
            part = record.window(first, min(block, record.steps - first))
            self.telemetry.publish(fill_loop_samples(LoopSamples(), AxisSamples, run, part))
        self.graph.wait_until(lambda: self._heard == (str(run), str(record.steps)), f"run {run} at the identifier")
        self.heard = record
        return run

    def model(self, record: LoopRecord) -> StateSpaceModel:
        """The last model, of this record if there is none yet."""
        if not self.get_model().success:
            self.publish(record)
            assert self.identify(order=4).success
        return self.get_model().model

    def identify(self, controller: str = PAPER, **request: Any) -> Any:
        return self.graph.call(Identify, "/amb/identifier/identify", controller=controller, **request)

    def validate(self, controller: str = PAPER, **request: Any) -> Any:
        return self.graph.call(Validate, "/amb/identifier/validate", controller=controller, **request)

    def certify(self, **request: Any) -> Any:
        return self.graph.call(Certify, "/amb/identifier/certify", **request)

    def get_model(self) -> Any:
        return self.graph.call(GetModel, "/amb/identifier/get_model")

    def send(self, controller: str = PAPER, **goal: Any) -> tuple[Any, list[Any]]:
        """Send a goal; its handle, and the feedback as it comes."""
        feedback: list[Any] = []
        wanted = IdentifyAction.Goal(controller=controller, **goal)
        handle = self.graph.send_goal(self.action, wanted, lambda message: feedback.append(message.feedback))
        return handle, feedback

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == "amb/identifier":
                values = {item.key: item.value for item in status.values}
                self._heard = (values["run"], str(int(values["first step"]) + int(values["steps"])))
