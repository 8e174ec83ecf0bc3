"""config/thrust.yaml: a machine of five axes from the parameter file to regions, identification and figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_controller_node.parameters import PdControllerParameters
from amb_core.excitation import Multisine, generate
from amb_core.ground.parameters import load_parameters
from amb_core.identification import identify
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.machine import radial_bearings
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.simulation import simulate
from amb_core.regions import Region, classify, layout_of
from amb_core.report.figures import orbit_chart, response_chart
from amb_sim_node.parameters import SimulatorParameters

FILE = Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / "thrust.yaml"
AXES = ("x_a", "y_a", "x_b", "y_b", "z")


def parameters(**rotor: float) -> PlantParameters:
    parameters = load_parameters(SimulatorParameters, FILE, "simulator")
    return parameters.model_copy(update={"rotor": parameters.rotor.model_copy(update=rotor)})


@pytest.fixture(scope="module")
def gains() -> ControllerParameters:
    return load_parameters(PdControllerParameters, FILE, "pd_controller")


@pytest.fixture(scope="module")
def excited(gains: ControllerParameters) -> tuple[Plant, LoopRecord]:
    """Orthogonal multisines over all five axes, without hysteresis to be quick; the first tenth of a second settles."""
    whole = parameters()
    simple = whole.model_copy(update={"iron": whole.iron.model_copy(update={"saturation": False, "hysteresis": False})})
    plant = Plant(simple)
    signal = generate(
        Multisine(amplitude=2e-6, axes="orthogonal", duration=2.5, frequency_start=2.0, frequency_end=1500.0),
        10_000.0,
        plant.machine,
    )
    record = simulate(plant, PdController(gains, 5), 1000 + signal.steps, signal.samples, 1000)
    return plant, record.window(1000, signal.steps)


def test_the_machine_names_the_thrust_bearing():
    machine = Plant(parameters()).machine
    assert machine.axis_names == AXES
    z = machine.axes[-1]
    assert (z.bearing, z.direction, z.bias_current, z.current_limit) == ("thrust", (0.0, 0.0, 1.0), 3.0, 3.0)
    assert (z.actuator_position, z.sensor_position) == (0.25, 0.30)
    assert [bearing.name for bearing in machine.bearings] == ["a", "b", "thrust"]
    assert machine.bearings[-1].clearance == 250e-6


def test_the_loop_is_stable_with_margin(gains):
    model = linearize(Plant(parameters()), gains)
    assert model.stable
    assert model.peak_sensitivity < 2.0


@pytest.mark.parametrize("start", [-200e-6, 200e-6])
def test_it_levitates_from_an_axial_offset(gains, start):
    plant = Plant(parameters(initial_z=start))
    record = simulate(plant, PdController(gains, 5), 2000)
    assert not plant.delevitated
    assert record.axes == AXES
    assert record.position[0, 4] == start
    assert np.abs(record.position[-500:, 4]).max() < 0.06 * abs(start)  # the rest creeps away: half order
    assert np.abs(record.position[-500:, :4]).max() < 20e-6


def test_orthogonal_multisines_excite_all_axes(excited):
    _, record = excited
    experiments = record.reference.reshape(5, -1, 5)
    spectra = np.fft.rfft(experiments, axis=1)[:, 5]  # of a line: experiments by axes
    gram = spectra.conj().T @ spectra
    np.testing.assert_allclose(gram, gram[0, 0].real * np.eye(5), atol=1e-6 * abs(gram[0, 0]))


@pytest.mark.slow  # identification of a 5x5 model
def test_an_identified_model_has_the_names_of_the_axes_and_five_unstable_poles(excited):
    _, record = excited
    model = identify(record, order=15, method="pbsid").model
    assert tuple(model.input_names) == tuple(f"i_{name}" for name in AXES)
    assert tuple(model.output_names) == AXES
    assert len(model.unstable_poles()) == 5


def test_regions_know_the_thrust_bearing(excited):
    plant, record = excited
    layout = layout_of(plant.machine)
    assert [bearing.axes for bearing in layout.bearings] == [AXES[:2], AXES[2:4], AXES[4:]]
    assert [bearing.radial for bearing in layout.bearings] == [True, True, False]
    assert classify(record, machine=plant.machine).states[-1].region < Region.D


def test_touching_the_axial_backup_bearing_is_region_d_of_the_thrust_bearing(gains):
    weak = gains.model_copy(update={"proportional_gains": (20e3, 20e3, 20e3, 20e3, 0.0)})
    plant = Plant(parameters(initial_z=200e-6))
    record = simulate(plant, PdController(weak, 5), 3000)
    state = classify(record, machine=plant.machine).states[-1]
    assert state.region == Region.D
    assert {bearing.name: bearing.region == Region.D for bearing in state.bearings} == {
        "a": False, "b": False, "thrust": True,
    }  # fmt: skip


def test_orbits_are_drawn_of_radial_bearings_and_responses_of_all_axes(excited):
    _, record = excited
    short = record.window(record.first_step, 500)
    assert [plane.axes for plane in radial_bearings(short)] == [AXES[:2], AXES[2:4]]
    assert len(orbit_chart(short).figure().axes) == 2
    assert len(response_chart(short).figure().axes) == 5
