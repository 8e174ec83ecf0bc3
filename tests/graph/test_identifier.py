"""The identifier: a model from live telemetry and from a bag, and an answer to every bad request."""

from __future__ import annotations

import signal
from array import array
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.control import ControllerParameters, PdController
from amb_core.identification import StateSpaceModel as CoreModel
from amb_core.messages import model_from_message
from amb_core.records import LoopRecord
from amb_msgs.msg import ExcitationStatus, LoopSamples, StateSpaceModel
from amb_msgs.srv import GetModel, Identify, StartRecording, StopRecording
from amb_ros.models import model_to_message
from amb_ros.qos import HISTORY, LATCHED

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

IDENTIFIER = "amb_ident_node.identifier"
BLOCK = 100
STEPS = 8_000
FIRST_STEP = 1_000  # of the excitation
SAMPLE_TIME = 1e-4


@pytest.fixture(scope="module")
def record() -> LoopRecord:
    """The linearised bearing (two unstable real poles per axis of 230 1/s) under square waves, with PD controller."""
    controller = PdController(ControllerParameters())
    stiffness, gain = 3.3e5 / 6.25, 66.0 / 6.25  # k_s / m (1/s^2), k_i / m (m/(A s^2))
    rate = np.sqrt(stiffness)
    cosh, sinh = np.cosh(rate * SAMPLE_TIME), np.sinh(rate * SAMPLE_TIME)
    a = np.array([[cosh, sinh / rate], [rate * sinh, cosh]])
    b = gain * np.array([(cosh - 1.0) / stiffness, sinh / rate])
    rng = np.random.default_rng(1)
    reference = np.zeros((STEPS, 2))
    reference[FIRST_STEP:] = 2e-5 * np.sign(rng.normal(size=((STEPS - FIRST_STEP) // 50, 2))).repeat(50, axis=0)
    position, current = np.empty((STEPS, 2)), np.empty((STEPS, 2))
    state = np.zeros((2, 2))
    for step in range(STEPS):
        position[step] = state[0] + 1e-9 * rng.normal(size=2)
        current[step] = controller.update(*position[step], *reference[step])
        state = a @ state + np.outer(b, current[step])
    return LoopRecord(0, SAMPLE_TIME, reference, position, current)


class Loop:
    """Publishes a record as the controller would."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.telemetry = graph.node.create_publisher(LoopSamples, "/amb/telemetry", HISTORY)
        self.status = graph.node.create_publisher(ExcitationStatus, "/amb/excitation_status", LATCHED)

    def publish(self, record: LoopRecord, run: int = 1, skip: tuple[int, ...] = ()) -> None:
        self.status.publish(
            ExcitationStatus(
                run=run, id=1, kind="square", accepted=True, first_step=FIRST_STEP, steps=STEPS - FIRST_STEP
            )
        )
        for first in range(0, record.steps, BLOCK):
            if first in skip:
                continue
            part = record.window(first, BLOCK)
            samples = {
                f"{name}_{axis}": array("d", getattr(part, name)[:, column].tobytes())
                for name in ("reference", "position", "current")
                for column, axis in enumerate("xy")
            }
            self.telemetry.publish(LoopSamples(run=run, first_step=first, sample_time=SAMPLE_TIME, **samples))

    def start(self) -> None:
        """Start the identifier and wait until it hears the loop."""
        listeners = [publisher.get_subscription_count() for publisher in (self.telemetry, self.status)]
        self.process = self.graph.start(IDENTIFIER, parameters={"parameter_timeout": 0.2})
        self.graph.wait_until(
            lambda: (
                self.telemetry.get_subscription_count() > listeners[0]
                and self.status.get_subscription_count() > listeners[1]
            ),
            what="the identifier",
        )

    def identify(self, **request: Any) -> Any:
        return self.graph.call(Identify, "/amb/identifier/identify", **request)


@pytest.fixture
def loop(graph: Graph) -> Loop:
    return Loop(graph)


def test_the_last_experiment_gives_a_model(loop: Loop, graph: Graph, record: LoopRecord) -> None:
    models: list[StateSpaceModel] = []
    loop.start()
    loop.publish(record)
    answer = loop.identify(order=4)
    assert answer.success, answer.message
    assert answer.model.order == 4
    assert answer.model.samples == STEPS - FIRST_STEP
    assert answer.model.source == f"run 1, steps {FIRST_STEP} to {STEPS - 1}"
    assert min(answer.model.fit) > 95.0
    assert "the paper's assumed" in answer.message, "nobody runs a pd_controller here"

    known = graph.call(GetModel, "/amb/identifier/get_model")
    assert known.success
    assert known.model == answer.model
    graph.node.create_subscription(StateSpaceModel, "/amb/model", models.append, LATCHED)
    graph.wait_until(lambda: models, what="the model for a late listener")
    assert models == [answer.model]

    model = model_from_message(answer.model)
    assert len(model.unstable_poles()) == 2
    np.testing.assert_allclose(np.log(model.unstable_poles()) / SAMPLE_TIME, np.sqrt(3.3e5 / 6.25), rtol=0.02)
    assert model_to_message(model, answer.model.header.stamp) == answer.model, "no bit is lost on the way"


def test_the_controller_is_asked_for_its_parameters(loop: Loop, graph: Graph, record: LoopRecord) -> None:
    controller = graph.add_node("pd_controller", "/amb")
    controller.declare_parameter("proportional_gain", 20_000.0)
    controller.declare_parameter("telemetry_block", 100)
    loop.start()
    loop.publish(record)
    answer = loop.identify(order=4)
    assert answer.success
    assert "assumed" not in answer.message


def test_a_bag_gives_the_same_model_here_and_on_the_command_line(loop: Loop, graph: Graph, record: LoopRecord) -> None:
    graph.start("amb_ident_node.recorder")
    started = graph.call(StartRecording, "/amb/recorder/start")
    loop.start()
    loop.publish(record)
    live = loop.identify(order=4)
    graph.call(StopRecording, "/amb/recorder/stop", wait_for_run=1, wait_for_step=STEPS)
    answer = loop.identify(order=4, bag=started.uri)
    assert answer.success, answer.message
    assert answer.model.source == started.uri
    assert answer.model.a == live.model.a
    assert answer.model.fit == live.model.fit

    shown = CliRunner().invoke(app, ["bag", "info", started.uri])
    assert shown.exit_code == 0
    assert "/amb/telemetry" in shown.output
    assert f"steps 0 to {STEPS - 1}" in shown.output
    file = graph.folder / "model.json"
    shown = CliRunner().invoke(
        app, ["identify", started.uri, "--order", "4", "--out", str(file), "--figures", str(graph.folder / "figures")]
    )
    assert shown.exit_code == 0, shown.output
    np.testing.assert_array_equal(CoreModel.load(file).a, model_from_message(answer.model).a)
    figures = {path.name for path in (graph.folder / "figures").iterdir()}
    assert figures >= {"response.png", "response.html", "orbit.png", "orbit.html"}


def test_the_node_answers_while_it_computes(loop: Loop, graph: Graph, record: LoopRecord) -> None:
    loop.start()
    loop.publish(record)
    client = graph.node.create_client(Identify, "/amb/identifier/identify")
    graph.wait_until(client.service_is_ready)
    graph.wait_until(lambda: loop.identify(order=4).success, what="telemetry")
    slow = client.call_async(Identify.Request(order=30))
    assert graph.call(GetModel, "/amb/identifier/get_model").success
    assert not slow.done()
    graph.wait_until(slow.done, what="the model of order 30")


def test_bad_requests_are_answered_with_the_reason(
    loop: Loop, graph: Graph, record: LoopRecord, tmp_path: Path
) -> None:
    loop.start()
    assert "no model has been identified yet" in graph.call(GetModel, "/amb/identifier/get_model").message
    assert "no telemetry heard on /amb/telemetry" in loop.identify().message
    loop.publish(record)
    for request, reason in (
        ({"order": 4000}, "order"),
        ({"method": "magic"}, "unknown method 'magic'; allowed:"),
        ({"first_step": -7}, "first_step = -7"),
        ({"first_step": 20_000}, "no samples from step 20000 on"),
        ({"first_step": 7_000, "steps": 5_000}, "steps 8000 to 11999 are missing"),
        ({"first_step": 7_000, "steps": 20}, "samples"),
        ({"bag": str(tmp_path / "nowhere")}, "there is no such file or folder"),
        ({"bag": str(tmp_path)}, "not a bag"),
    ):
        answer = loop.identify(**request)
        assert not answer.success
        assert reason in answer.message, request
        assert "internal error" not in answer.message
    assert loop.identify(order=4).success, "none of this has hurt the node"


@pytest.mark.parametrize("what", ["not finite", "constant"])
def test_data_that_determine_no_model_are_refused(loop: Loop, record: LoopRecord, what: str) -> None:
    position = record.position.copy()
    current = record.current.copy()
    if what == "not finite":
        position[5_000, 1] = np.nan
    else:
        current[:, 0] = 0.5
    loop.start()
    loop.publish(LoopRecord(0, SAMPLE_TIME, record.reference, position, current))
    answer = loop.identify(order=4)
    assert not answer.success
    assert what in answer.message


def test_missing_telemetry_is_named_unless_it_is_not_used(loop: Loop, record: LoopRecord) -> None:
    loop.start()
    loop.publish(record, skip=(500, 3_000))
    answer = loop.identify(order=4)
    assert not answer.success
    assert "steps 3000 to 3099 are missing" in answer.message
    assert loop.identify(order=4, first_step=3_100).success


def test_a_new_run_replaces_the_one_before(loop: Loop, record: LoopRecord) -> None:
    loop.start()
    loop.publish(record, run=1)
    loop.publish(record, run=2)
    assert loop.identify(order=4).model.source.startswith("run 2")


def test_a_signal_ends_the_node_with_code_0(loop: Loop, graph: Graph) -> None:
    loop.start()
    graph.call(GetModel, "/amb/identifier/get_model")
    code, errors = graph.stop(loop.process, signal.SIGINT)
    assert code == 0, errors
