"""Messages and requests that no node of the workbench sends: each is answered or reported, and no node dies."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically

from amb_core.ground.errors import BagError
from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.recording.messages.loop_samples import block_from_message
from amb_msgs.msg import (
    AxisReference,
    AxisSamples,
    CurrentReference,
    Excitation,
    LoopSamples,
    RotorPosition,
    SimulatorState,
)
from amb_msgs.srv import Pause, Reset, RunSteps
from amb_ros.qos import EVERY_STATE, HISTORY, STREAM
from tests.fuzz.hostile import DELIVERED
from tests.graph.bearing import Bearing, machine_message, machine_publisher

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.pd_controller"
LAST_STEP = (2**31 - 1) * 10_000  # whose time a ROS time stamp can hold, at 10 kHz
LARGEST = 2**64 - 1
LIMIT = 3.0  # A, of the control current references


class Wires:
    """A simulator and a controller in namespaces of their own, with the test at the other end of their topics."""

    def __init__(self, bearing: Bearing) -> None:
        self.bearing, self.graph = bearing, bearing.graph
        self.positions: list[RotorPosition] = []
        self.answers: list[CurrentReference] = []
        node = self.graph.node
        self.graph.start(SIMULATOR)
        # Not the simulator's: its positions come from the test.
        self.graph.start(CONTROLLER, "-r", "position:=test/position", "-r", "current_reference:=test/current_reference")
        self.position = node.create_publisher(RotorPosition, "/amb/test/position", STREAM)
        self.current = node.create_publisher(CurrentReference, "/amb/current_reference", STREAM)
        node.create_subscription(RotorPosition, "/amb/position", self.positions.append, STREAM)
        node.create_subscription(CurrentReference, "/amb/test/current_reference", self.answers.append, STREAM)
        for publisher in (self.position, self.current):
            self.graph.wait_until(publisher.get_subscription_count, publisher.topic_name)
        self._run = 0

    def new_run(self) -> int:
        self._run += 1
        return self._run

    def answer(self, run: int, step: int, x: float = 0.0, time: float | None = None) -> CurrentReference:
        """What the controller answers to a position."""
        self.tell(run, step, x, time)
        self.graph.wait_until(
            lambda: self.answers and (self.answers[-1].run, self.answers[-1].step) == (run, step), "the answer"
        )
        return self.answers[-1]

    def tell(self, run: int, step: int, x: float = 0.0, time: float | None = None) -> None:
        time = 1e-4 * step if time is None else time
        self.position.publish(RotorPosition(run=run, step=step, time=time, position=[x, 0.0]))

    def health(self, node: str) -> DiagnosticStatus:
        """The last word of a node on /diagnostics, once it has come."""
        name = f"amb/{node}"
        known = len(self.bearing.diagnostics)

        def words() -> list[DiagnosticStatus]:
            return [status for status in self.bearing.diagnostics[known:] if status.name == name]

        self.graph.wait_until(words, f"a word of {name}")
        return words()[-1]


def wires_of(graph: Graph) -> Wires:
    return Wires(Bearing(graph))


@pytest.fixture
def wires(share: Callable[..., Wires]) -> Wires:
    return share(wires_of, lambda wires: wires.bearing.resets())


# -- the simulator


@pytest.mark.parametrize("steps", [LARGEST, 2**63, LAST_STEP + 1])
def test_a_run_beyond_the_time_that_ros_can_tell_is_refused(wires: Wires, steps: int) -> None:
    wires.bearing.reset()
    refused = wires.graph.call(RunSteps, "/amb/simulator/run", steps=steps)
    assert not refused.success
    assert f"steps = {steps} is not allowed; allowed: 0 (until paused) to {LAST_STEP}" in refused.message
    assert wires.graph.call(RunSteps, "/amb/simulator/run", steps=LAST_STEP).last_step == LAST_STEP
    assert wires.graph.call(Pause, "/amb/simulator/pause").success


@pytest.mark.parametrize("current", [math.nan, math.inf, -math.inf])
def test_a_current_reference_that_is_not_finite_ends_the_run_with_the_reason(wires: Wires, current: float) -> None:
    run = wires.bearing.reset()
    wires.graph.call(RunSteps, "/amb/simulator/run", steps=0)
    wires.current.publish(CurrentReference(run=run, step=0, current=[current, 0.0]))
    wires.graph.wait_until(
        lambda: (wires.bearing.states[-1].run, wires.bearing.states[-1].mode) == (run, SimulatorState.FAULT), "a fault"
    )
    health = wires.health("simulator")
    assert health.level == DiagnosticStatus.ERROR
    assert "control current references" in health.message
    assert "not finite at sample 1" in health.message
    assert "reset it first" in wires.graph.call(RunSteps, "/amb/simulator/run", steps=1).message


@pytest.mark.parametrize("current", [1e300, -1e300, 1e-300])
def test_no_current_reference_makes_a_position_that_is_not_finite(wires: Wires, current: float) -> None:
    run = wires.bearing.reset()
    wires.graph.call(RunSteps, "/amb/simulator/run", steps=0)
    for step in range(3):
        wires.current.publish(CurrentReference(run=run, step=step, current=[current, current]))
        wires.graph.wait_until(
            lambda step=step: (
                wires.bearing.states[-1].mode == SimulatorState.FAULT
                or (wires.positions[-1].run, wires.positions[-1].step) == (run, step + 1)
            ),
            "the next step",
        )
    assert wires.graph.call(Pause, "/amb/simulator/pause").success
    assert all(math.isfinite(value) for position in wires.positions for value in position.position)


def test_run_numbers_grow_over_many_resets_and_a_restart(wires: Wires) -> None:
    runs = [wires.graph.call(Reset, "/amb/simulator/reset").run for _ in range(300)]
    assert runs == sorted(set(runs))
    simulator = wires.graph.process_of(SIMULATOR)
    simulator.kill()
    simulator.wait()
    seen = len(wires.bearing.states)
    wires.graph.start(SIMULATOR)
    wires.graph.wait_until(lambda: len(wires.bearing.states) > seen, "the new simulator")
    assert wires.bearing.states[-1].run > max(runs)


# -- the controller


@pytest.mark.parametrize("time", [0.0, -0.0, math.nan, math.inf, -1.0, 5e-324])
def test_a_first_step_of_impossible_time_is_an_error_on_diagnostics(wires: Wires, time: float) -> None:
    run = wires.new_run()
    wires.answer(run, 0)
    wires.answer(run, 1, time=time)
    health = wires.health("pd_controller")
    assert health.level == DiagnosticStatus.ERROR
    assert "the machine has a sample rate of 10000 Hz" in health.message


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf, 1e300, -1.1])
def test_a_position_that_would_spoil_the_law_is_reported_and_leaves_no_trace(wires: Wires, x: float) -> None:
    run = wires.new_run()
    expected = [wires.answer(run, step, 1e-6 * step).current[0] for step in range(3)]
    run = wires.new_run()
    answers = [wires.answer(run, 0).current[0], wires.answer(run, 1, 1e-6).current[0]]
    wires.tell(run, 2, x)
    wires.graph.wait_until(lambda: wires.health("pd_controller").level == DiagnosticStatus.ERROR, "the error")
    health = wires.health("pd_controller")
    assert f"at step 2 of run {run} is not answered; allowed: finite values up to 1 m" in health.message
    answers.append(wires.answer(run, 2, 2e-6).current[0])
    assert answers == expected
    assert 0.0 < abs(answers[-1]) < LIMIT
    wires.answer(wires.new_run(), 0)
    wires.graph.wait_until(lambda: wires.health("pd_controller").level == DiagnosticStatus.OK, "the end of the error")


@pytest.mark.parametrize("step", [LARGEST, 2**63, LAST_STEP + 1])
def test_a_position_of_a_step_beyond_time_is_reported(wires: Wires, step: int) -> None:
    run = wires.new_run()
    wires.answer(run, 0)
    wires.tell(run, step, time=0.0)
    wires.graph.wait_until(lambda: wires.health("pd_controller").level == DiagnosticStatus.ERROR, "the error")
    assert f"at step {step} of run {run} is not answered" in wires.health("pd_controller").message
    assert wires.answer(LARGEST, LAST_STEP).step == LAST_STEP
    wires.answer(wires.new_run(), 0)


@pytest.mark.parametrize("data", DELIVERED)
def test_bytes_that_are_no_message_are_reported_and_the_loop_goes_on(wires: Wires, data: bytes) -> None:
    run = wires.new_run()
    wires.answer(run, 0)
    wires.position.publish(data)
    wires.graph.wait_until(lambda: wires.health("pd_controller").level == DiagnosticStatus.ERROR, "the error")
    reason = f"the message cannot be read: its {len(data)} bytes are no "
    assert f"a position is not answered: {reason}RotorPosition" in wires.health("pd_controller").message
    assert wires.answer(run, 1).step == 1
    wires.current.publish(data)
    wires.graph.wait_until(lambda: wires.health("simulator").level == DiagnosticStatus.WARN, "the warning")
    assert f"a current_reference is ignored: {reason}CurrentReference" in wires.health("simulator").message
    wires.bearing.reset()


# -- telemetry


@pytest.mark.parametrize(
    ("first_step", "sample_time", "reason"),
    [
        (LARGEST, 1e-4, "exceeds the range of a ROS time stamp"),
        (LAST_STEP, 1e-4, "exceeds the range of a ROS time stamp"),
        (0, 5e-324, "must be positive; allowed: 1e-07 s to 10 s"),
        (0, math.inf, "must be positive; allowed: 1e-07 s to 10 s"),
        (0, math.nan, "must be positive; allowed: 1e-07 s to 10 s"),
    ],
)
def test_telemetry_of_no_loop_is_refused(first_step: int, sample_time: float, reason: str) -> None:
    axes = [AxisSamples(name=axis, reference=[0.0], position=[0.0], current=[0.0]) for axis in "xy"]
    with pytest.raises(BagError, match=reason):
        block_from_message(LoopSamples(run=1, first_step=first_step, sample_time=sample_time, axes=axes))


def test_telemetry_without_steps_is_refused() -> None:
    axes = [AxisSamples(name=axis) for axis in "xy"]
    with pytest.raises(BagError, match="telemetry block of run 1 at step 7: it has no steps; allowed: 1 or more"):
        block_from_message(LoopSamples(run=1, first_step=7, sample_time=1e-4, axes=axes))


@pytest.mark.parametrize("module", ["amb_ident_node.identifier", "amb_ident_node.region_monitor"])
def test_who_listens_to_telemetry_refuses_what_is_none_and_goes_on(graph: Graph, module: str) -> None:
    bearing = Bearing(graph)
    process = graph.start(module)
    publisher = graph.node.create_publisher(LoopSamples, "/amb/telemetry", HISTORY)
    graph.wait_until(publisher.get_subscription_count, module)
    for data in DELIVERED:
        publisher.publish(data)
    publisher.publish(LoopSamples(run=1, sample_time=1e-4, axes=[AxisSamples(name=axis) for axis in "xy"]))
    graph.wait_until(
        lambda: any("it has no steps; allowed: 1 or more" in status.message for status in bearing.diagnostics),
        "the refusal",
    )
    assert process.poll() is None


# -- parameters


def values(*given: tuple[str, Any]) -> list[ParameterMessage]:
    return [ParameterMessage(name=name, value=value) for name, value in given]


def integer(value: int) -> ParameterValue:
    return ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=value)


def double(value: float) -> ParameterValue:
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)


def test_a_gain_given_as_an_integer_is_taken_at_run_time_as_at_the_start(wires: Wires) -> None:
    def gain() -> ParameterValue:
        return wires.graph.call(GetParameters, "/amb/pd_controller/get_parameters", names=["proportional_gain"]).values[
            0
        ]

    run = wires.new_run()
    before = wires.answer(run, 0, 1e-5).current[0]
    for service, factor in ((SetParameters, 1.5), (SetParametersAtomically, 1.0)):
        name = "set_parameters" if service is SetParameters else "set_parameters_atomically"
        request = values(("proportional_gain", integer(int(20_000 * factor))))
        answer = wires.graph.call(service, f"/amb/pd_controller/{name}", parameters=request)
        (result,) = answer.results if service is SetParameters else [answer.result]
        assert result.successful, result.reason
        assert (gain().type, gain().double_value) == (ParameterType.PARAMETER_DOUBLE, 20_000.0 * factor)
        assert wires.answer(wires.new_run(), 0, 1e-5).current[0] == pytest.approx(factor * before)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        (
            "proportional_gain",
            ParameterValue(type=4, string_value="21000"),
            "'21000' is not allowed; allowed: 0 to",
        ),
        ("proportional_gain", ParameterValue(type=1, bool_value=True), "True is not allowed; allowed: 0 to 1e+06 A/m"),
        (
            "proportional_gain",
            ParameterValue(type=8, double_array_value=[1.0] * 9),
            "is not allowed; allowed: 0 to 1e+06",
        ),
        ("proportional_gain", ParameterValue(), "None is not allowed; allowed: 0 to 1e+06 A/m"),
        ("proportional_gain", ParameterValue(type=42), "None is not allowed; allowed: 0 to 1e+06 A/m"),
        ("proportional_gain", double(math.nan), "Min"),
        ("proportional_gain", double(-1.0), "Min"),
        ("proportional_gain", integer(2**63 - 1), "Min"),
        ("derivative_on", ParameterValue(type=4, string_value="error"), "read-only"),
        ("derivative_on", ParameterValue(type=42), "without a value"),
        ("colour", integer(1), "unknown parameter 'colour'; known: proportional_gain"),
        ("", integer(1), "unknown parameter"),
        ("use_sim_time", ParameterValue(type=42), "without a value"),
    ],
)
def test_a_wrong_parameter_is_refused_in_one_line(wires: Wires, name: str, value: ParameterValue, reason: str) -> None:
    for service in (SetParameters, SetParametersAtomically):
        service_name = "set_parameters" if service is SetParameters else "set_parameters_atomically"
        answer = wires.graph.call(service, f"/amb/pd_controller/{service_name}", parameters=values((name, value)))
        (result,) = answer.results if service is SetParameters else [answer.result]
        assert not result.successful
        assert reason in result.reason
        assert "\n" not in result.reason
    wires.answer(wires.new_run(), 0)


# -- two graphs


def test_the_clock_of_a_graph_in_another_namespace_is_its_own(wires: Wires) -> None:
    other = wires.graph.start_command([sys.executable, "-m", SIMULATOR, "--ros-args", "-r", "__ns:=/left"])
    node = wires.graph.node
    wires.graph.wait_until(lambda: node.count_publishers("/left/clock"), "the clock of the other graph")
    # Perhaps twice: a simulator that was killed stays in the graph for some 20 s.
    assert {publisher.node_namespace for publisher in node.get_publishers_info_by_topic("/clock")} == {"/amb"}
    wires.graph.stop(other)


def test_a_machine_that_changes_within_a_run_is_an_error_and_the_run_goes_on(wires: Wires) -> None:
    run = wires.new_run()
    wires.answer(run, 0)
    whole = machine_of(PlantParameters())
    publisher = machine_publisher(wires.graph.node)
    excitations = wires.graph.node.create_publisher(Excitation, "/amb/excitation", EVERY_STATE)
    wires.graph.wait_until(lambda: publisher.get_subscription_count() and excitations.get_subscription_count(), "it")
    publisher.publish(machine_message(replace(whole, axes=whole.axes[:1])))
    step = iter(range(1, 100_000))

    def changed() -> bool:
        wires.answer(run, next(step))
        return "the machine changed within run" in wires.health("pd_controller").message

    wires.graph.wait_until(changed, "the controller to note the change")
    # One axis less than the run has; a node that trusted the latest machine would add it to both.
    waveform = {"kind": "waveform", "run": run, "sample_time": 1e-4, "first_step": Excitation.FROM_NEXT_STEP}
    on_y = AxisReference(name="y", reference=[1e-6] * 50_000)
    excitations.publish(Excitation(id=1, axes=[on_y], **waveform))
    wires.graph.wait_until(lambda: any(wires.answer(run, next(step)).current), "the excitation")
    assert wires.answers[-1].current[0] == 0.0
    publisher.publish(machine_message(whole))
    wires.graph.wait_until(
        lambda: "the machine changed" not in wires.health("pd_controller").message, "the end of the error"
    )
