"""The loop over topics: the same samples as without ROS, whatever the placement, pauses and failures."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

from amb_core.excitation import Square, generate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.plant.simulation import simulate
from amb_msgs.msg import AxisSignals, CurrentReference, RotorPosition, SimulatorState
from amb_msgs.srv import Pause, RunSteps, StartExcitation, StopExcitation
from amb_ros.qos import STREAM
from amb_sim_node.parameters import SimulatorParameters
from tests.graph.bearing import Bearing, machine_message, machine_publisher
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from amb_core.loop.records import LoopRecord
    from tests.graph.conftest import Graph

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.pd_controller"
GENERATOR = "amb_controller_node.excitation_generator"
IDENTIFIER = "amb_ident_node.identifier"
COMPOSED = "amb_bringup.graph.composed_loop"
STEPS = 1_050  # not a whole number of telemetry blocks
SQUARE = Square(amplitude=20e-6, duration=0.08, frequency=50.0, axes="in_turn")
EXCITED_FROM = 200


def excited_without_ros(steps: int) -> LoopRecord:
    controller = PdController(ControllerParameters())
    signal = generate(SQUARE, 10_000.0)
    return simulate(Plant(), controller, steps, signal.samples, EXCITED_FROM)


@pytest.fixture(scope="module")
def without_ros() -> LoopRecord:
    return excited_without_ros(STEPS)


def separate_processes(graph: Graph) -> Bearing:
    for module in (SIMULATOR, CONTROLLER, GENERATOR):
        graph.start(module)
    return Bearing(graph)


def composed_process(graph: Graph) -> Bearing:
    for module in (COMPOSED, GENERATOR):
        graph.start(module)
    return Bearing(graph)


@pytest.fixture
def separate(share: Any) -> Bearing:
    """A loop of processes, for tests that leave it able to start a new run."""
    return share(separate_processes, Bearing.resets)


@pytest.fixture
def composed(share: Any) -> Bearing:
    """The same with simulator and controller in one process."""
    return share(composed_process, Bearing.resets)


@pytest.fixture
def paused_loop(separate: Bearing) -> Bearing:
    """A loop, paused at step 100 of a run."""
    run = separate.reset()
    separate.run(100)
    separate.wait_for_step(run, 100)
    return separate


@pytest.mark.parametrize("placement", ["composed", "separate"])
def test_samples_over_topics_equal_those_without_ros_bit_for_bit(request, without_ros, placement):
    bearing = request.getfixturevalue(placement)
    for _ in range(2):
        run = bearing.reset()
        bearing.excite(SQUARE, run, EXCITED_FROM)
        bearing.run(STEPS)
        assert bearing.record(run, STEPS).identical_to(without_ros)


def test_signals_for_plots_are_samples_of_the_telemetry_and_change_nothing(separate, without_ros):
    heard: list[AxisSignals] = []
    node = separate.graph.node
    listeners = [node.create_subscription(AxisSignals, f"/amb/signals/{axis}", heard.append, STREAM) for axis in "xy"]
    run = separate.reset()
    separate.excite(SQUARE, run, EXCITED_FROM)  # the controller knows the axes
    separate.run(1)
    for listener in listeners:
        separate.graph.wait_until(listener.get_publisher_count, listener.topic_name)
    separate.wait_for_step(run, 1)
    separate.run(STEPS - 1)
    record = separate.record(run, STEPS)
    assert record.identical_to(without_ros)

    def of_this_run(axis: str) -> dict[int, AxisSignals]:
        return {message.step: message for message in heard if (message.run, message.header.frame_id) == (run, axis)}

    for column, axis in enumerate("xy"):
        separate.graph.wait_until(lambda axis=axis: 1_000 in of_this_run(axis), f"the last signal of {axis}")
        assert set(of_this_run(axis)) - {0} == set(range(100, STEPS, 100))  # by default 100 Hz
        for step, message in of_this_run(axis).items():
            assert message.header.stamp.nanosec == step * 100_000
            assert message.position == record.position[step, column]
            assert message.reference == record.reference[step, column]
            assert message.control_current == record.current[step, column]
    for listener in listeners:
        node.destroy_subscription(listener)


def test_pauses_do_not_change_the_samples(separate):
    run = separate.reset()
    separate.excite(SQUARE, run, EXCITED_FROM)
    separate.run(333)
    separate.wait_for_step(run, 333)
    separate.run(0)  # until paused
    paused = separate.graph.call(Pause, "/amb/simulator/pause")
    assert paused.step >= 333
    end = separate.run(500).last_step
    assert end == paused.step + 500
    assert separate.record(run, end).identical_to(excited_without_ros(end))


def test_run_request_ends_at_its_last_step(separate):
    run = separate.reset()
    answer = separate.run(250)
    assert (answer.run, answer.first_step, answer.last_step) == (run, 0, 250)
    separate.wait_for_step(run, 250)
    state = separate.wait_for_mode(SimulatorState.PAUSED)
    assert state.step == 250
    assert separate.record(run, 250).steps == 250


def test_run_request_is_refused_while_running(separate):
    separate.reset()
    separate.run(0)
    answer = separate.graph.call(RunSteps, "/amb/simulator/run", steps=10)
    assert not answer.success
    assert "pause it first" in answer.message


def test_killed_controller_is_reported_within_a_second_and_the_loop_resumes_when_it_is_back(separate):
    run = separate.reset()
    separate.run(0)
    separate.wait_for_step(run, 200)
    controller = separate.graph.process_of(CONTROLLER)
    controller.kill()
    controller.wait()
    stalled = separate.wait_for_mode(SimulatorState.WAITING).step

    def complained() -> bool:
        complaint = f"no answer from the controller to step {stalled}"
        return any(
            status.name == "amb/simulator" and status.level == DiagnosticStatus.ERROR and complaint in status.message
            for status in separate.diagnostics
        )

    separate.graph.wait_until(complained, "the simulator's complaint")
    # In the simulator's own clock: it looks every `answer_timeout`, and the second look at a step is the complaint.
    looks = [state.mode for state in separate.states if (state.run, state.step) == (run, stalled)]
    assert looks.count(SimulatorState.RUNNING) <= 1
    assert 2.0 * SimulatorParameters().answer_timeout <= 1.0
    separate.graph.start(CONTROLLER)
    separate.wait_for_step(run, stalled + 200)


def test_delevitation_ends_the_run_until_a_reset(separate, tmp_path):
    heavy, normal = tmp_path / "heavy.yaml", tmp_path / "normal.yaml"
    heavy.write_text("/amb/simulator: {ros__parameters: {rotor: {mass: 50.0}}}")  # more than the magnets can carry
    normal.write_text("/amb/simulator: {ros__parameters: {}}")
    run = separate.reset(heavy)
    separate.run(0)
    state = separate.wait_for_mode(SimulatorState.DELEVITATED)
    assert state.run == run
    record = separate.record(run, state.step)
    assert np.hypot(*record.position[-1]) < 250e-6
    answer = separate.graph.call(RunSteps, "/amb/simulator/run", steps=10)
    assert not answer.success
    assert "delevitated" in answer.message
    assert "reset it first" in answer.message
    later = separate.reset(normal)
    assert later > run
    separate.run(10)
    separate.wait_for_step(later, 10)


def test_stop_returns_the_reference_to_nominal(separate):
    run = separate.reset()
    separate.excite(SQUARE.model_copy(update={"duration": 10.0}), run, 0)
    separate.run(100)
    separate.wait_for_step(run, 100)
    assert separate.graph.call(StopExcitation, "/amb/excitation_generator/stop").success
    separate.run(100)
    reference = separate.record(run, 200).reference
    assert np.abs(reference[:100]).max() == SQUARE.amplitude
    assert np.abs(reference[100:]).max() == 0.0


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"kind": "triangle", "amplitude": 1e-5, "duration": 1.0}, "unknown kind of excitation 'triangle'; allowed:"),
        ({"kind": "square", "amplitude": float("nan"), "duration": 1.0}, "'amplitude' = nan is not allowed"),
        ({"kind": "square", "amplitude": -1e-5, "duration": 1.0}, "'amplitude' = -1e-05 is not allowed"),
        ({"kind": "square", "amplitude": 1.0, "duration": 1.0}, "'amplitude' = 1.0 is not allowed; allowed:"),
        ({"kind": "square", "amplitude": 1e-5, "duration": 1.0, "frequency": -5.0}, "'frequency' = -5.0"),
        ({"kind": "square", "amplitude": 1e-5, "duration": 1.0, "frequency": 5_001.0}, "Nyquist"),
        ({"kind": "sweep", "amplitude": 1e-5, "duration": 1.0, "frequency_end": 6_000.0}, "Nyquist"),
        ({"kind": "square", "amplitude": 1e-5}, "no default for 'duration'"),
        (
            {"kind": "square", "amplitude": 1e-5, "duration": 1.0, "axes": "z"},
            "axes = 'z' is not allowed; allowed: x, y, bearing_a",
        ),
        (
            {"kind": "square", "amplitude": 1e-5, "duration": 1.0, "first_step": 99},
            "in the past; allowed: 100 or later",
        ),
        (
            {"kind": "square", "amplitude": 1e-5, "duration": 1.0, "interleaved": True},
            "square does not use 'interleaved' = True",
        ),
        ({"kind": "square", "amplitude": 1e-5, "duration": 1.0, "first_step": -2}, "first_step = -2 is not allowed"),
    ],
)
def test_generator_refuses_bad_requests_with_the_reason(paused_loop, fields, reason):
    answer = paused_loop.graph.call(StartExcitation, "/amb/excitation_generator/start", **{"first_step": -1, **fields})
    assert not answer.success
    assert reason in answer.message
    assert "\n" not in answer.message


def test_generator_takes_the_phases_of_a_multisine(paused_loop):
    asked = {"kind": "multisine", "amplitude": 1e-6, "duration": 1.0, "phasing": "schroeder", "interleaved": True}
    answer = paused_loop.graph.call(StartExcitation, "/amb/excitation_generator/start", first_step=-1, **asked)
    assert answer.success, answer.message
    assert answer.steps == 10_000


def test_generator_alone_says_who_is_missing(graph):
    graph.start(GENERATOR, parameters={"answer_timeout": 0.2})

    def refusal(run: int) -> str:
        answer = graph.call(
            StartExcitation, "/amb/excitation_generator/start", kind="square", amplitude=1e-5, duration=1.0, run=run
        )
        assert not answer.success
        return answer.message

    assert "is the simulator running?" in refusal(run=0)
    assert "is the simulator, or the bridge to the rig, running?" in refusal(run=1)
    machines = machine_publisher(graph.node)
    machines.publish(machine_message(machine_of(PlantParameters())))
    graph.wait_until(lambda: "is the controller running?" in refusal(run=1), "the generator to know the machine")


def test_gains_can_be_changed_while_running_and_wrong_ones_are_refused(paused_loop):
    def set_parameter(name: str, value: float | int) -> Any:
        parameter = Parameter(name, value=value).to_parameter_msg()
        return paused_loop.graph.call(
            SetParameters, "/amb/pd_controller/set_parameters", parameters=[parameter]
        ).results[0]

    assert set_parameter("proportional_gain", 21_000.0).successful
    values = paused_loop.graph.call(
        GetParameters, "/amb/pd_controller/get_parameters", names=["proportional_gain"]
    ).values
    assert values[0].double_value == 21_000.0
    assert set_parameter("proportional_gain", 20_000.0).successful
    assert not set_parameter("proportional_gain", -1.0).successful
    refused = set_parameter("telemetry_block", 200)
    assert not refused.successful
    assert "read-only" in refused.reason


def test_a_list_holds_one_value_per_axis_or_none(paused_loop):
    def set_list(*values: float) -> Any:
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=values)
        parameter = ParameterMessage(name="nominal_reference", value=value)
        return paused_loop.graph.call(
            SetParameters, "/amb/pd_controller/set_parameters", parameters=[parameter]
        ).results[0]

    def read_list() -> list[float]:
        (value,) = paused_loop.graph.call(
            GetParameters, "/amb/pd_controller/get_parameters", names=["nominal_reference"]
        ).values
        assert value.type == ParameterType.PARAMETER_DOUBLE_ARRAY
        return list(value.double_array_value)

    assert read_list() == []
    assert set_list(0.0, 40e-6).successful
    assert read_list() == [0.0, 40e-6]
    assert "3 values; the machine has 2 axes; allowed: 2, or none" in set_list(0.0, 0.0, 0.0).reason
    assert "= [1.0, 0.0] is not allowed; allowed: a list of numbers from -0.001 to 0.001 m" in set_list(1.0, 0.0).reason
    assert read_list() == [0.0, 40e-6]
    assert set_list().successful
    assert read_list() == []


def test_controller_alone_answers_repeated_positions_alike_and_reports_another_rate_than_the_machine_has(
    graph, bearing
):
    answers: list[CurrentReference] = []
    graph.node.create_subscription(CurrentReference, "/amb/current_reference", answers.append, STREAM)
    publisher = graph.node.create_publisher(RotorPosition, "/amb/position", STREAM)
    machines = machine_publisher(graph.node)
    graph.start(CONTROLLER)
    graph.wait_until(
        lambda: publisher.get_subscription_count() and graph.node.count_publishers("/amb/current_reference"),
        "the controller",
    )
    publisher.publish(RotorPosition(run=1, step=0, time=0.0, position=[1e-6, 0.0]))
    graph.wait_until(
        lambda: any("waiting for the machine on /amb/machine" in status.message for status in bearing.diagnostics),
        "the controller to say what it waits for",
    )
    assert not answers
    machines.publish(machine_message(replace(machine_of(PlantParameters()), sample_rate=5_000.0)))
    graph.wait_until(lambda: _answered(publisher, answers), "the first answer")
    first = answers[-1].current[0]
    publisher.publish(RotorPosition(run=1, step=1, time=1e-4, position=[2e-6, 0.0]))
    publisher.publish(RotorPosition(run=1, step=1, time=1e-4, position=[2e-6, 0.0]))
    graph.wait_until(lambda: sum(answer.step == 1 for answer in answers) == 2, "two answers")
    currents = [answer.current[0] for answer in answers if answer.step == 1]
    assert currents[0] == currents[1] != first
    graph.wait_until(
        lambda: any("positions arrive at 10000 Hz" in status.message for status in bearing.diagnostics),
        "the complaint",
    )


def _answered(publisher: Any, answers: list[CurrentReference]) -> bool:
    publisher.publish(RotorPosition(run=1, step=0, time=0.0, position=[1e-6, 0.0]))
    time.sleep(0.02)
    return bool(answers)


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_controller_that_ends_in_a_run_publishes_all_samples_that_it_has_answered(graph, bearing, by):
    graph.start(SIMULATOR)
    controller = graph.start(CONTROLLER, parameters={"telemetry_block": 10_000})
    answers: list[CurrentReference] = []
    graph.node.create_subscription(CurrentReference, "/amb/current_reference", answers.append, STREAM)
    run = bearing.reset()
    bearing.run(0)
    graph.wait_until(lambda: answers and answers[-1].step > 50, "some steps")
    assert graph.stop(controller, by) == (0, "")
    bearing.wait_for_mode(SimulatorState.WAITING)
    answered = {answer.step for answer in answers if answer.run == run}
    assert max(answered) < 10_000, "the first block was full"
    bearing.record(run, len(answered))


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_nodes_end_cleanly_when_told_to(graph, by):
    processes = {module: graph.start(module) for module in (SIMULATOR, CONTROLLER, GENERATOR, COMPOSED)}
    nodes = ["excitation_generator", "pd_controller", "pd_controller", "simulator", "simulator"]
    graph.wait_until(
        lambda: sorted(name for name, space in graph.node.get_node_names_and_namespaces() if space == "/amb") == nodes,
        "all nodes",
    )
    for process in processes.values():
        process.send_signal(by)
    for process in processes.values():
        process.wait_for_end(TIMEOUT)
    for process in processes.values():  # two of a name may have met before
        lines = [
            line for line in process.said.splitlines() if "2 nodes publish" not in line and "are named" not in line
        ]
        assert (process.returncode, lines) == (0, [])


def test_restarted_simulator_starts_a_run_that_nobody_takes_for_an_old_one(separate):
    run = separate.reset()
    separate.excite(SQUARE, run, 0)
    separate.run(100)
    separate.wait_for_step(run, 100)
    separate.graph.stop(separate.graph.process_of(SIMULATOR))
    separate.graph.start(SIMULATOR)
    later = separate.reset()
    assert later > run
    separate.run(100)
    assert np.abs(separate.record(later, 100).reference).max() == 0.0  # the excitation was for the old run
