"""The identifier: a model from live telemetry and from a bag, its validation, and an answer to every bad request."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rclpy.duration import Duration
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client import AmbClient, ClientError
from amb_core.identification import IdentificationProgress
from amb_core.identification import StateSpaceModel as CoreModel
from amb_core.loop.machine import DIRECTIONS, Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter
from amb_core.recording.messages.state_space_model import fill_model, model_from_message
from amb_msgs.msg import SimulatorState, StateSpaceModel
from amb_msgs.srv import Identify, StartRecording, StopRecording
from amb_ros.qos import LATCHED
from tests import bag_messages
from tests.graph.bearing import machine_message, machine_publisher
from tests.graph.identifier_loop import FIRST_STEP, PAPER, SAMPLE_TIME, STEPS, Loop, linear_loop
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

LONG = 100_000  # steps; some ten seconds of work
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/GoalStatus


@pytest.fixture(scope="module")
def record() -> LoopRecord:
    return linear_loop(STEPS)


@pytest.fixture
def loop(share: Callable[..., Any]) -> Loop:
    return share(Loop, lambda made: made.process.poll() is None)


def test_without_data_and_model_the_answers_say_so(graph: Graph) -> None:
    loop = Loop(graph)
    assert "no model has been identified yet" in loop.get_model().message
    assert "no model has been identified yet" in loop.validate().message
    assert "no telemetry received yet; run an experiment first or name a bag" in loop.identify().message


def test_the_last_experiment_gives_a_model(loop: Loop, record: LoopRecord) -> None:
    run = loop.publish(record)
    answer = loop.identify(order=4)
    assert answer.success, answer.message
    assert answer.model.order == 4
    assert answer.model.samples == STEPS - FIRST_STEP
    assert answer.model.source == f"run {run}, steps {FIRST_STEP} to {STEPS - 1}"
    assert (list(answer.model.input_units), list(answer.model.output_units)) == (["A", "A"], ["m", "m"])
    assert min(answer.model.fit) > 95.0
    assert answer.message.endswith("; controller: paper, as requested")

    known = loop.get_model()
    assert known.success
    assert known.model == answer.model
    models: list[StateSpaceModel] = []
    loop.graph.node.create_subscription(StateSpaceModel, "/amb/model", models.append, LATCHED)
    loop.graph.wait_until(lambda: models, what="the model for a late listener")
    assert models == [answer.model]

    model = model_from_message(answer.model)
    assert len(model.unstable_poles()) == 2
    np.testing.assert_allclose(np.log(model.unstable_poles()) / SAMPLE_TIME, np.sqrt(3.3e5 / 6.25), rtol=0.02)
    back = fill_model(StateSpaceModel(header=answer.model.header, sequence=answer.model.sequence), model)
    assert back == answer.model, "no bit is lost on the way"


def test_a_model_is_judged_by_another_run_and_from_a_file(loop: Loop, record: LoopRecord, tmp_path: Path) -> None:
    loop.publish(record)
    identified = loop.identify(order=4)
    assert identified.success, identified.message
    loop.publish(linear_loop(STEPS, seed=2))
    answer = loop.validate()
    assert answer.success, answer.message
    assert answer.validated, answer.report
    assert answer.message.endswith("; controller: paper, as requested")
    assert answer.closed_loop_stable
    assert answer.independent
    assert answer.unstable_poles == 2
    assert min(answer.fit) > 95.0
    assert min(answer.one_step_fit) > 95.0
    assert len(answer.report.splitlines()) > 10

    model = model_from_message(identified.model)
    model.save(tmp_path / "model.json")
    assert loop.validate(model=str(tmp_path / "model.json")).fit == answer.fit
    assert "cannot be read" in loop.validate(model=str(tmp_path / "nowhere.json")).message
    assert "there is no such file or folder" in loop.validate(bag=str(tmp_path / "nowhere")).message


def test_delevitation_is_judged_live_as_from_a_bag(graph: Graph, record: LoopRecord, tmp_path: Path) -> None:
    machine = linear_machine(record, 0.8 * float(np.linalg.norm(record.position, axis=1).max()))
    publisher = machine_publisher(graph.node)
    loop = Loop(graph)
    graph.wait_until(publisher.get_subscription_count, "the identifier")
    publisher.publish(machine_message(machine))
    assert publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
    run = loop.publish(record)
    bag = write_bag(tmp_path / "bag", machine, record, run)
    part = {"first_step": FIRST_STEP, "steps": STEPS - FIRST_STEP}
    live, from_bag = loop.identify(order=4, **part), loop.identify(order=4, bag=str(bag), **part)
    assert any("region D (delevitated)" in text for text in live.warnings), live.warnings
    assert (live.verdict, live.warnings) == (from_bag.verdict, from_bag.warnings)
    live, from_bag = loop.validate(**part), loop.validate(bag=str(bag), **part)
    findings = [
        answer.report.partition("CLOSED LOOP")[2] for answer in (live, from_bag)
    ]  # behind the names of the data
    assert findings[0] and findings[0] == findings[1]
    assert live.verdict == from_bag.verdict


def linear_machine(record: LoopRecord, clearance: float = 250e-6) -> Machine:
    """A machine of one bearing with the axes of a record."""
    axes = tuple(MachineAxis(name, "a", 0.0, 0.0, DIRECTIONS[name], 2.5, 3.0) for name in record.axes)
    return Machine("ours", "simulator", 1.0 / SAMPLE_TIME, axes, (MachineBearing("a", clearance),))


def write_bag(folder: Path, machine: Machine, record: LoopRecord, run: int) -> Path:
    """A bag of this machine and run."""
    with BagWriter(folder) as bag:
        for topic, kind in (("/amb/machine", bag_messages.MACHINE), ("/amb/telemetry", bag_messages.TELEMETRY)):
            bag.add_topic(topic, kind, bag_messages.definition(kind))
        bag.write("/amb/machine", bag_messages.machine_message(machine), 10**18)
        bag.write("/amb/telemetry", bag_messages.telemetry(record, run), 10**18)
    return folder


def test_no_controller_is_assumed(loop: Loop, record: LoopRecord, tmp_path: Path) -> None:
    loop.publish(record)
    assert loop.identify(order=4).success
    for call in (loop.identify, loop.validate):
        answer = call(controller="")
        assert not answer.success
        assert "node pd_controller does not give the parameters of the controller; name it in `controller`: paper" in (
            answer.message
        )
        assert "node /amb/other did not report its parameters within 0.1 s" in call(controller="other").message
        assert f"parameter file {tmp_path}/no.yaml" in call(controller=f"{tmp_path}/no.yaml").message


def test_none_leaves_the_closed_loop_out_of_live_data_as_of_a_bag(
    loop: Loop, record: LoopRecord, tmp_path: Path
) -> None:
    run = loop.publish(record)
    bag = write_bag(tmp_path / "bag", linear_machine(record), record, run)
    part = {"order": 4, "first_step": FIRST_STEP, "steps": STEPS - FIRST_STEP, "controller": "none"}
    live, from_bag = loop.identify(**part), loop.identify(bag=str(bag), **part)
    assert live.success, live.message
    assert "closed loop not simulated" in live.message
    assert list(live.model.fit) == list(from_bag.model.fit) == []
    assert (live.verdict, live.message) == (from_bag.verdict, from_bag.message)


def test_a_parameter_file_names_the_controller(loop: Loop, record: LoopRecord, tmp_path: Path) -> None:
    loop.publish(record)
    paper, other = tmp_path / "paper.yaml", tmp_path / "other.yaml"
    paper.write_text("/amb/pd_controller: {ros__parameters: {proportional_gain: 20000.0, telemetry_block: 10}}\n")
    other.write_text("/amb/pd_controller: {ros__parameters: {proportional_gain: 30000.0}}\n")
    expected = loop.identify(order=4)
    named = loop.identify(order=4, controller=str(paper))
    assert named.success, named.message
    assert named.model.fit == expected.model.fit
    assert loop.identify(order=4, controller=str(other)).model.fit != expected.model.fit
    assert loop.validate(controller=str(other)).fit != loop.validate(controller=str(paper)).fit


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ({"order": 4000}, "order 4000 is not allowed; allowed: 1 to 40"),
        ({"order": 4, "auto_order": True}, "order = 4 is not allowed with auto_order; allowed: 0"),
        ({"method": "magic"}, "unknown method 'magic'; allowed:"),
        ({"focus": "near"}, "unknown focus 'near'; allowed:"),
        ({"first_step": -7}, "first_step = -7 is not allowed"),
        ({"bag": "/nowhere"}, "there is no such file or folder"),
        ({"bag": "x" * 5_000}, "there is no such file or folder"),
        ({"controller": "/nowhere.yaml"}, "parameter file /nowhere.yaml"),
    ],
)
def test_a_bad_goal_is_rejected_and_the_client_knows_why(loop: Loop, goal: dict[str, Any], reason: str) -> None:
    handle, _ = loop.send(**goal)
    assert not handle.accepted
    if goal.pop("auto_order", False):
        return  # the client cannot ask for it
    with AmbClient(domain_id=int(loop.graph.environment["ROS_DOMAIN_ID"])) as amb:
        for _ in range(2):  # the second time an old reason is known as well
            with pytest.raises(ClientError) as caught:
                amb.identify(**{"controller": PAPER} | goal)
            assert "/amb/identifier/identify: " in str(caught.value)
            assert reason in str(caught.value)


def test_a_bag_gives_the_same_model_here_and_on_the_command_line(loop: Loop, record: LoopRecord) -> None:
    graph = loop.graph
    recorder = graph.start("amb_ident_node.recorder")
    graph.node.create_publisher(SimulatorState, "/amb/simulator/state", LATCHED)  # what a recorder waits for
    started = graph.call(StartRecording, "/amb/recorder/start")
    run = loop.publish(record)
    live = loop.identify(order=4)
    stopped = graph.call(StopRecording, "/amb/recorder/stop", wait_for_run=run, wait_for_step=STEPS)
    assert stopped.success, stopped.message
    graph.stop(recorder)
    answer = loop.identify(order=4, bag=started.uri)
    assert answer.success, answer.message
    assert answer.model.source == f"{started.uri}, run {run}"
    assert answer.model.a == live.model.a
    assert answer.model.fit == live.model.fit

    shown = CliRunner().invoke(app, ["bag", "info", started.uri, "--runs"])
    assert shown.exit_code == 0
    assert "/amb/telemetry" in shown.output
    assert f"steps 0 to {STEPS - 1}" in shown.output
    file = graph.folder / "model.json"
    shown = CliRunner().invoke(
        app, ["identify", started.uri, "--order", "4", "--controller", PAPER, "--out", str(file)]
    )
    assert shown.exit_code == 0, shown.output
    assert answer.verdict in (Identify.Response.VALIDATED_WITH_RESERVATIONS, Identify.Response.NOT_VALIDATED)
    assert f"{answer.verdict.replace('_', ' ')} on the data of the estimate" in " ".join(shown.output.split())
    assert answer.message.startswith(answer.verdict.replace("_", " "))
    np.testing.assert_array_equal(CoreModel.load(file).a, model_from_message(answer.model).a)


def test_bad_requests_are_answered_with_the_reason(loop: Loop, record: LoopRecord, tmp_path: Path) -> None:
    loop.publish(record)
    for request, reason in (
        ({"order": 4000}, "order"),
        ({"order": 4, "auto_order": True}, "order = 4 is not allowed with auto_order"),
        ({"method": "magic"}, "unknown method 'magic'; allowed:"),
        ({"focus": "near"}, "unknown focus 'near'; allowed:"),
        ({"first_step": -7}, "first_step = -7"),
        ({"first_step": 20_000}, "no samples from step 20000 on"),
        ({"first_step": 5_000, "steps": 5_000}, "steps 6000 to 9999 are missing"),
        ({"first_step": 5_000, "steps": 20}, "samples"),
        ({"bag": str(tmp_path / "nowhere")}, "there is no such file or folder"),
        ({"bag": str(tmp_path)}, "not a bag"),
    ):
        answer = loop.identify(**request)
        assert not answer.success
        assert reason in answer.message, request
        assert "internal error" not in answer.message
    answer = loop.identify(order=4, first_step=5_800)
    assert answer.success, answer.message
    assert answer.warnings[0].startswith("inputs: x: the reference does not move"), "for 20 ms"
    assert answer.warnings[1].startswith("offsets: x: a straight line"), "20 ms of square waves look like a drift"


@pytest.mark.parametrize("what", ["NaN", "constant"])
def test_data_that_determine_no_model_are_refused(loop: Loop, record: LoopRecord, what: str) -> None:
    position = record.position.copy()
    current = record.current.copy()
    if what == "NaN":
        position[5_000, 1] = np.nan
    else:
        current[:, 0] = 0.5
    loop.publish(LoopRecord(0, SAMPLE_TIME, record.reference, position, current))
    answer = loop.identify(order=4)
    assert not answer.success
    assert what in answer.message
    assert "internal error" not in answer.message


def test_missing_telemetry_is_named_unless_it_is_not_used(loop: Loop, record: LoopRecord) -> None:
    loop.publish(record, skip=(500, 3_000))
    answer = loop.identify(order=4)
    assert not answer.success
    assert "steps 3000 to 3099 are missing" in answer.message
    assert loop.identify(order=4, first_step=3_100).success


# -- long identifications


@pytest.fixture(scope="module")
def long_record() -> LoopRecord:
    """A run whose identification takes some ten seconds."""
    short = linear_loop(FIRST_STEP + LONG // 10)
    tail = short.window(FIRST_STEP, LONG // 10)
    repeated = {
        name: np.vstack([getattr(short, name)[:FIRST_STEP], np.tile(getattr(tail, name), (10, 1))])
        for name in ("reference", "position", "current")
    }
    return LoopRecord(0, SAMPLE_TIME, **repeated)


@pytest.fixture
def long(loop: Loop, record: LoopRecord, long_record: LoopRecord) -> StateSpaceModel:
    """The identifier has heard of that run, and has a model of another."""
    model = loop.model(record)
    if loop.heard is not long_record:
        loop.publish(long_record, block=5_000)
    return model


def test_the_action_tells_how_far_it_is_and_other_services_are_answered_meanwhile(
    loop: Loop, long: StateSpaceModel
) -> None:
    handle, feedback = loop.send()
    while not any(report.stage == "pem" for report in feedback):
        assert loop.get_model().model == long
        assert handle.status < SUCCEEDED, "still at work"
    assert loop.validate(first_step=2_000, steps=2_000).success
    assert handle.status < SUCCEEDED, "validation does not wait for the end of the identification"
    stages = list(dict.fromkeys(report.stage for report in feedback))
    assert stages[:3] == ["checks", "subspace", "pem"]
    costs = [report.cost for report in feedback if report.stage == "pem"]
    assert costs == sorted(costs, reverse=True)
    assert all(report.done <= report.total for report in feedback)

    waiting, _ = loop.send()
    loop.graph.cancel(waiting)
    status, result = loop.graph.result_of(waiting)
    assert (status, result.message) == (CANCELED, "cancelled before it began")
    assert handle.status < SUCCEEDED, "a goal that waits for others ends without waiting"

    loop.graph.cancel(handle)
    status, result = loop.graph.result_of(handle)
    assert (status, result.success) == (CANCELED, False)
    assert "identification cancelled in pem" in result.message
    assert loop.get_model().model == long, "what is cancelled leaves the last model"


def test_the_client_shows_progress_and_cancels(loop: Loop, long: StateSpaceModel) -> None:
    reports: list[IdentificationProgress] = []
    with AmbClient(domain_id=loop.graph.domain, timeout=TIMEOUT) as amb:
        model = amb.identify(order=4, first_step=2_000, steps=4_000, progress=reports.append, controller=PAPER)
        assert (model.order, model.samples) == (4, 4_000)
        assert {"checks", "subspace", "pem", "validation"} <= {progress.stage for progress in reports}
        np.testing.assert_array_equal(amb.get_model().a, model.a)
        assert amb.validate(first_step=7_000, steps=4_000, controller=PAPER).validated
        reports.clear()
        with pytest.raises(ClientError, match="identification cancelled in"):
            amb.identify(progress=reports.append, cancelled=lambda: bool(reports), controller=PAPER)


def test_a_signal_ends_the_node_in_the_middle_of_an_identification(loop: Loop, long: StateSpaceModel) -> None:
    _, feedback = loop.send()
    loop.graph.wait_until(
        lambda: any(report.stage == "subspace" for report in feedback), "work that cannot be broken off"
    )
    code, errors = loop.graph.stop(loop.process, signal.SIGINT)
    assert code == 0, errors
    assert "Traceback" not in errors
    assert {report.stage for report in feedback} <= {"checks", "subspace"}, "it did not go on with the work"


def test_the_controller_is_asked_for_its_parameters(graph: Graph, record: LoopRecord) -> None:
    controller = graph.add_node("pd_controller", "/amb")
    controller.declare_parameter("proportional_gain", 20_000.0)
    controller.declare_parameter("telemetry_block", 100)
    loop = Loop(graph)
    loop.publish(record)
    answer = loop.identify(order=4, controller="")
    assert answer.success, answer.message
    assert "controller" not in answer.message
    named = loop.identify(order=4, controller="/amb/pd_controller")
    assert named.model.fit == answer.model.fit
    assert named.message.endswith("; controller: /amb/pd_controller, as requested")
