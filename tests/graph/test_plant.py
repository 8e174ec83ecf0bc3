"""The plant behind the simulator: what plant_state reports of it, resets to other parameters, touch-downs."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python

from amb_core.ground.parameters import load_parameters
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_core.recording import Recording
from amb_msgs.msg import PlantState, SimulatorState
from amb_msgs.srv import Reset, RunSteps, StartRecording, StopRecording
from amb_ros.qos import STREAM
from amb_sim_node.parameters import SimulatorParameters
from tests.graph.bearing import Bearing

if TYPE_CHECKING:
    from amb_core.loop.records import LoopRecord
    from tests.graph.conftest import Graph

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.pd_controller"
RECORDER = "amb_ident_node.recorder"
EVERY = 20
STEPS = 210
TOO_HEAVY = {"rotor": {"mass": 50.0}}  # kg; more than the magnets can carry


def parameter_file(path: Path, parameters: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump({"/amb/simulator": {"ros__parameters": parameters}}))
    return path


def loop_without_ros(parameters: SimulatorParameters, steps: int) -> LoopRecord:
    return simulate(Plant(parameters), PdController(ControllerParameters()), steps)


def run_to(bearing: Bearing, run: int, steps: int) -> LoopRecord:
    bearing.run(steps)
    return bearing.record(run, steps)


def states_of(bearing: Bearing, run: int) -> list[PlantState]:
    return [state for state in bearing.plant_states if state.run == run]


def simulator_parameters(graph: Graph, *names: str) -> list[Any]:
    values = graph.call(GetParameters, "/amb/simulator/get_parameters", names=names).values
    return [parameter_value_to_python(value) for value in values]


def simulator_and_controller(graph: Graph) -> Bearing:
    graph.start(SIMULATOR)
    graph.start(CONTROLLER)
    return Bearing(graph)


@pytest.fixture
def loop(share: Any, tmp_path: Path) -> Bearing:
    """The loop at step 0 of a run with default parameters; a reset gives the simulator others."""
    bearing: Bearing = share(simulator_and_controller, Bearing.resets)
    bearing.reset(parameter_file(tmp_path / "defaults.yaml", {}))
    return bearing


# -- plant_state


def test_states_of_the_plant_come_at_their_steps_with_what_is_in_the_plant(loop: Bearing, tmp_path: Path) -> None:
    run = loop.reset(parameter_file(tmp_path / "states.yaml", {"plant_state_steps": EVERY}))
    record = run_to(loop, run, STEPS)
    wanted = list(range(0, STEPS, EVERY))
    loop.graph.wait_until(lambda: [state.step for state in states_of(loop, run)] == wanted, "the states")
    states = states_of(loop, run)
    for state in states:
        assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == state.step * 100_000
        # Ideal sensors: the journal is where telemetry says, bit for bit.
        assert (state.position_x[0], state.position_y[0]) == tuple(record.position[state.step])
        assert len(state.coil_current) == 4
        assert len(state.flux_density) == 8
        assert len(state.force_x) == len(state.force_y) == len(state.contact_force) == 1
        assert state.contact == [False]
        assert state.contact_force[0] == 0.0
    first = states[0]
    assert list(first.coil_current) == pytest.approx([3.0] * 4, abs=0.15)  # bias, on its way to the ripple's mean
    assert np.abs(first.flux_density) == pytest.approx([0.31] * 8, abs=0.02)  # paper: about 0.31 T
    assert abs(first.force_y[0]) < 1.0
    sunk = states[-1]  # gravity has pulled for 20 ms, and the upper magnet takes over the weight
    assert sunk.coil_current[1] > 3.0 > sunk.coil_current[3]
    assert sunk.force_y[0] == pytest.approx(6.25 * 9.81, rel=0.1)
    assert abs(sunk.force_x[0]) < 1.0


def test_states_of_the_plant_are_not_published_by_default(loop: Bearing, tmp_path: Path) -> None:
    run = loop.reset()
    run_to(loop, run, STEPS)
    # What the next run publishes comes after all that this one could have published.
    after = loop.reset(parameter_file(tmp_path / "states.yaml", {"plant_state_steps": EVERY}))
    loop.run(STEPS)
    loop.graph.wait_until(lambda: states_of(loop, after), "a state")
    assert states_of(loop, run) == []


def test_states_of_a_rotor_in_two_bearings_are_those_of_both(loop: Bearing, tmp_path: Path) -> None:
    two = {"plant_state_steps": EVERY, "rotor": {"model": "rigid"}}
    run = loop.reset(parameter_file(tmp_path / "two.yaml", two))
    loop.run(STEPS)
    loop.graph.wait_until(lambda: any(state.step == 200 for state in states_of(loop, run)), "the states")
    state = states_of(loop, run)[-1]
    kinds = PlantState.get_fields_and_field_types()
    sizes = {name: len(getattr(state, name)) for name, kind in kinds.items() if kind.startswith("sequence")}
    assert sizes == {
        "coil_current": 8,
        "flux_density": 16,
        "force_x": 2,
        "force_y": 2,
        "position_x": 2,
        "position_y": 2,
        "contact": 2,
        "contact_force": 2,
    }


def test_states_of_the_plant_and_changed_parameters_are_in_the_bag(loop: Bearing, tmp_path: Path) -> None:
    graph = loop.graph
    recorder = graph.start(RECORDER)
    assert graph.call(StartRecording, "/amb/recorder/start", uri="bag").success
    run = loop.reset(parameter_file(tmp_path / "light.yaml", {"rotor": {"mass": 5.0}, "plant_state_steps": EVERY}))
    run_to(loop, run, STEPS)
    stopped = graph.call(StopRecording, "/amb/recorder/stop", wait_for_run=run, wait_for_step=STEPS)
    assert stopped.success, stopped.message
    graph.stop(recorder)
    bag = Recording.read(stopped.uri)
    record = bag.plant_states(run)
    assert record.step.tolist() == list(range(0, STEPS, EVERY))
    np.testing.assert_array_equal(record.position[:, 0], bag.telemetry(run).position[record.step])
    assert bag.parameters()["/amb/simulator"]["rotor.mass"] == 5.0


# -- reset with a parameter file


def test_reset_with_a_parameter_file_gives_the_samples_of_the_loop_without_ros(loop: Bearing) -> None:
    folder = loop.graph.folder
    loop.reset(parameter_file(folder / "running.yaml", {"rotor": {"running_speed": 100.0}}))
    other = {"rotor": {"mass": 5.0, "gravity": 0.0, "initial_x": 20e-6}, "magnetic_circuit": {"coupling": False}}
    file = parameter_file(folder / "other.yaml", other)
    before = loop.reset()
    run = loop.reset(file)
    assert run > before
    expected = loop_without_ros(load_parameters(SimulatorParameters, file, "simulator"), STEPS)
    assert run_to(loop, run, STEPS).identical_to(expected)
    again = loop.reset()  # without a file: the parameters stay
    assert run_to(loop, again, STEPS).identical_to(expected)
    # relative to the simulator's working directory; parameters that a file lacks take their defaults
    heavy = loop.reset(parameter_file(folder / "heavy.yaml", {"rotor": {"mass": 8.0}}).name)
    defaults = SimulatorParameters.model_validate({"rotor": {"mass": 8.0}})
    assert run_to(loop, heavy, STEPS).identical_to(loop_without_ros(defaults, STEPS))


def test_parameters_show_the_values_of_the_reset_and_stay_read_only(loop: Bearing, tmp_path: Path) -> None:
    graph = loop.graph
    names = ("rotor.mass", "rotor.gravity", "plant_state_steps")
    loop.reset(parameter_file(tmp_path / "heavy.yaml", {"rotor": {"mass": 7.0}}))
    assert simulator_parameters(graph, *names) == [7.0, 9.81, 0]
    events: list[ParameterEvent] = []
    graph.node.create_subscription(ParameterEvent, "/parameter_events", events.append, STREAM)
    masses = itertools.cycle((6.0, 7.0))

    def heard() -> bool:
        loop.reset(parameter_file(tmp_path / "mass.yaml", {"rotor": {"mass": next(masses)}}))
        return any(event.node == "/amb/simulator" for event in events)

    graph.wait_until(heard, "the simulator's events")
    loop.reset(parameter_file(tmp_path / "other.yaml", {"rotor": {"gravity": 0}, "plant_state_steps": 5}))
    assert simulator_parameters(graph, *names) == [6.25, 0.0, 5]

    def changes() -> list[list[str]]:
        changed = [sorted(parameter.name for parameter in event.changed_parameters) for event in events]
        return [names for names in changed if "rotor.gravity" in names]

    graph.wait_until(changes, "the parameter event")
    assert changes() == [sorted(names)]
    refused = graph.call(
        SetParameters,
        "/amb/simulator/set_parameters",
        parameters=[Parameter("rotor.mass", value=5.0).to_parameter_msg()],
    ).results[0]
    assert not refused.successful
    assert "read-only" in refused.reason
    described = graph.call(DescribeParameters, "/amb/simulator/describe_parameters", names=names).descriptors
    assert all(descriptor.read_only for descriptor in described)


def test_parameters_of_the_node_itself_are_those_of_the_file_too(graph: Graph, bearing: Bearing) -> None:
    graph.start(SIMULATOR, parameters={"answer_timeout": 10.0})
    bearing.reset(parameter_file(graph.folder / "quick.yaml", {"answer_timeout": 0.05, "autostart": True}))
    assert bearing.wait_for_mode(SimulatorState.PAUSED).step == 0  # autostart is for the start of the node
    assert graph.call(RunSteps, "/amb/simulator/run", steps=1).success
    bearing.wait_for_mode(SimulatorState.WAITING)  # there is no controller
    # In its own clock: it reports twice a second, so some twenty times within the period that it was started with.
    reports = [value.value for status in bearing.diagnostics for value in status.values if value.key == "mode"]
    assert reports.count("running") < 10


@pytest.fixture
def paused(loop: Bearing) -> Bearing:
    """The loop, paused at step 100 of its run."""
    run = loop.reset()
    loop.run(100)
    loop.wait_for_step(run, 100)
    loop.wait_for_mode(SimulatorState.PAUSED)
    return loop


@pytest.mark.parametrize(
    ("text", "reasons"),
    [
        (None, ["cannot be read", "No such file"]),
        ("a: [", ["cannot be read", "line 2"]),
        ("- 1", ["each entry must be a node name with a mapping 'ros__parameters'"]),
        ({"rotor": {"mass": -1.0}}, ["'rotor.mass' = -1.0 is not allowed; allowed: 0.001 to 100000 kg"]),
        ({"rotor": {"mass": "heavy"}}, ["'rotor.mass' = 'heavy' is not allowed"]),
        ({"rotor": {"masss": 1.0}}, ["unknown parameter 'rotor.masss' = 1.0; did you mean 'rotor.mass'?"]),
        ({"rotor": {"backup_bearing_radius": 1e-3}}, ["backup_bearing_radius = 0.001 m must be smaller than the air"]),
        ({"rotor": {"model": "flexible"}}, ["needs flexible_rotor.modal_data"]),
        (
            {"rotor": {"model": "flexible"}, "flexible_rotor": {"modal_data": "nowhere.npz"}},
            ["nowhere.npz"],
        ),
        ({"iron": {"saturation": True, "bh_table": "nowhere.csv"}}, ["nowhere.csv"]),
        (
            {"integration": {"internal_step": 1e-5}, "amplifier": {"switching": False}},
            ["integration.internal_step = 1e-05 s is too long for the eddy currents", "allowed: at most"],
        ),
        (
            {"integration": {"sample_rate": 5e3}},
            ["'integration.sample_rate' = 5000 Hz is not allowed; allowed: 10000 Hz, at which the simulator"],
        ),
    ],
)
def test_a_bad_file_is_refused_with_the_reason_and_nothing_changes(
    paused: Bearing, tmp_path: Path, text: object, reasons: list[str]
) -> None:
    file = tmp_path / "bad.yaml"
    if isinstance(text, dict):
        parameter_file(file, text)
    elif text is not None:
        file.write_text(str(text))
    before = paused.states[-1]
    answer = paused.graph.call(Reset, "/amb/simulator/reset", parameter_file=str(file))
    assert not answer.success
    assert answer.run == before.run
    for reason in (f"parameter file {file}", *reasons):
        assert reason in answer.message
    assert "\n" not in answer.message
    assert (paused.states[-1].run, paused.states[-1].step) == (before.run, before.step)
    assert simulator_parameters(paused.graph, "rotor.mass", "rotor.backup_bearing_radius") == [6.25, 250e-6]


def test_a_run_goes_on_after_a_refused_reset_as_if_nothing_had_been_asked(loop: Bearing, tmp_path: Path) -> None:
    run = loop.reset()
    loop.run(STEPS)
    # Refused only by the plant to be made, while the run goes on.
    file = parameter_file(tmp_path / "bad.yaml", {"integration": {"internal_step": 1e-5}})
    assert not loop.graph.call(Reset, "/amb/simulator/reset", parameter_file=str(file)).success
    assert loop.record(run, STEPS).identical_to(loop_without_ros(SimulatorParameters(), STEPS))


# -- contact


def test_touch_down_with_contact_is_a_warning_and_the_run_goes_on(loop: Bearing, tmp_path: Path) -> None:
    falling = TOO_HEAVY | {"backup_bearing": {"contact": True}, "plant_state_steps": 1}
    run = loop.reset(parameter_file(tmp_path / "falling.yaml", falling))
    loop.run(2_000)
    loop.wait_for_step(run, 2_000)
    assert loop.wait_for_mode(SimulatorState.PAUSED).step == 2_000
    assert {state.mode for state in loop.states if state.run == run} <= {
        SimulatorState.PAUSED,
        SimulatorState.RUNNING,
        SimulatorState.WAITING,
    }

    def warnings() -> list[DiagnosticStatus]:
        of_simulator = [status for status in loop.diagnostics if status.name == "amb/simulator"]
        return [status for status in of_simulator if status.level == DiagnosticStatus.WARN]

    loop.graph.wait_until(warnings, "the warning")
    assert {(status.name, status.message) for status in warnings()} == {
        ("amb/simulator", "the rotor touches the backup bearing")
    }
    loop.graph.wait_until(lambda: states_of(loop, run)[-1].step == 2_000, "the last state")
    touching = [state for state in states_of(loop, run) if state.contact[0]]
    assert touching
    assert max(state.contact_force[0] for state in touching) > 6.25 * 9.81
    assert not any(state.contact_force[0] for state in states_of(loop, run) if not state.contact[0])
    loop.reset()
    loop.graph.wait_until(lambda: loop.diagnostics[-1].level == DiagnosticStatus.OK, "the end of the warning")
