"""Linear model of the thrust bearing: the running plant about its equilibrium, beside the radial axes."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import validate
from amb_core.linear.model.modes import modes_of
from amb_core.linear.simulation import simulate as simulate_linear
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Linearization, Plant, PlantParameters, linearize
from amb_core.plant.simulation import simulate
from amb_core.plant.thrust_bearing import half_order, thrust_amplifier

RIG = {"rotor.model": "rigid", "rotor.axial": True}


def plant(**changes: object) -> Plant:
    return Plant(validate(PlantParameters, {**RIG, **changes}))


def controller(**changes: object) -> ControllerParameters:
    return ControllerParameters(derivative_gains=(38.0, 38.0, 38.0, 38.0, 80.0), **changes)


@pytest.fixture(scope="module")
def model() -> Linearization:
    return linearize(plant(), controller())


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"amplifier.switching": False},
        {"converters.computation_delay": 0.5, "sensor.bandwidth": 5000.0},
        {"thrust_bearing.eddy_currents": False, "amplifier.carriers": "interleaved"},
        {"amplifier.dead_time": 5e-7},
        {"thrust_bearing.integral_gain": 0.0},
    ],
)
def test_a_small_step_of_the_reference_moves_the_running_plant_as_the_model(changes):
    running, height = plant(**changes), 0.1e-6
    reference = np.zeros((200, 5))
    reference[50:, 4] = height
    record = simulate(running, PdController(controller(), 5), 200, reference)
    loop = linearize(running, controller()).closed_loop
    expected = simulate_linear(loop, reference)[:, 4]
    assert expected.max() > 1.2 * height
    assert np.abs(record.position[:, 4] - expected).max() < 2e-3 * expected.max()


def test_the_model_is_the_rotor_on_its_negative_stiffness_with_the_lag_of_half_order(model):
    frequency = np.geomspace(1.0, 50.0, 20)  # Hz; above, the amplifiers lag
    circuit, s = plant().axial.circuit, 2j * np.pi * frequency
    lag = half_order(frequency, circuit.lag)
    stiffness = circuit.negative_stiffness(3.0) / lag
    expected = circuit.current_gain(3.0) / lag / (12.5 * s**2 - stiffness)
    response = model.continuous.at(s)[:, 4, 4]
    np.testing.assert_allclose(np.abs(response), np.abs(expected), rtol=0.01)


def test_z_is_decoupled_and_the_radial_model_is_that_without_a_thrust_bearing(model):
    radial = linearize(plant(**{"rotor.axial": False}), ControllerParameters())
    at = np.exp(2j * np.pi * np.array([3.0, 30.0, 300.0]) * 1e-4)
    response = model.discrete.at(at)
    assert model.discrete.output_names == ("x_a", "y_a", "x_b", "y_b", "z")
    assert model.discrete.input_names[-1] == "i_z"
    assert not response[:, 4, :4].any()
    assert not response[:, :4, 4].any()
    np.testing.assert_allclose(response[:, :4, :4], radial.discrete.at(at), rtol=1e-9, atol=1e-18)
    assert radial.axial_point is None
    assert (np.abs(model.discrete.poles()) > 1.0).sum() == 5
    assert model.stable


def test_a_constant_force_moves_the_equilibrium_and_an_alternating_one_does_not():
    pushed = linearize(plant(**{"rotor.external_force_z": 100.0}), controller())
    point = pushed.axial_point
    circuit = plant().axial.circuit
    assert circuit.force(point.coil_current, point.position) == pytest.approx(-100.0, rel=1e-9)
    assert point.current_reference == pytest.approx(-20_000.0 * point.position)
    running = plant(**{"rotor.external_force_z": 100.0})
    settled = simulate(running, PdController(controller(), 5), 3000).position[-1, 4]
    assert settled == pytest.approx(point.position, rel=0.06)  # it creeps: half order
    alternating = {"rotor.external_force_z": 100.0, "rotor.external_force_frequency": 50.0}
    assert linearize(plant(**alternating), controller()).axial_point.position == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("dead_time", [0.0, 1e-6])
def test_bipolar_amplifiers_hold_with_a_negative_coil_current(dead_time):
    """Without integral part the control error makes the voltage that the resistance and the dead time take."""
    bipolar = {"amplifier.switching": False, "amplifier.limits": False, "amplifier.unipolar": False}
    pushed = {"rotor.external_force_z": -1000.0, "thrust_bearing.integral_gain": 0.0, "amplifier.dead_time": dead_time}
    held = plant(**bipolar, **pushed)
    point = linearize(held, controller(proportional_gain=200e3, current_limit=50.0)).axial_point
    amplifier, current = thrust_amplifier(held.parameters), point.coil_current[1]
    assert current < -0.1
    error = amplifier.bias_current - point.current_reference - current
    voltage = held.parameters.thrust_bearing.coil_resistance * current
    lost = dead_time * amplifier.switching_frequency
    driven = 2.0 * amplifier.supply_voltage * (amplifier.proportional_gain * error + lost)
    assert driven == pytest.approx(voltage, rel=1e-9)


def test_a_nominal_reference_of_z_is_where_it_is_held():
    offset = (0.0, 0.0, 0.0, 0.0, 50e-6)
    point = linearize(plant(), controller(nominal_reference=offset)).axial_point
    # The negative stiffness pulls the rotor beyond its reference.
    assert 50e-6 < point.position < 100e-6
    assert point.current_reference < 0.0


@pytest.mark.parametrize(
    ("force", "gain", "reason"),
    [
        (0.0, 3_000.0, r"K_P = 3000 A/m on axis z cannot hold the rotor of 12.5 kg along its axis"),
        (5_000.0, 20_000.0, "against an external force of 5000 N"),
    ],
)
def test_what_the_controller_cannot_hold_is_one_line(force, gain, reason):
    gains = controller(proportional_gains=(20_000.0, 20_000.0, 20_000.0, 20_000.0, gain))
    with pytest.raises(PlantError, match=reason) as refused:
        linearize(plant(**{"rotor.external_force_z": force}), gains)
    assert "\n" not in str(refused.value)


def test_its_modes_are_axial_and_leave_the_names_of_the_others(model):
    kinds = [mode.kind for mode in modes_of(model.closed_loop).selected().modes]
    assert kinds.count("translation") == 2
    assert kinds.count("tilt") == 2
    axial = modes_of(model.closed_loop).of_kind("axial")
    oscillating = [mode for mode in axial if mode.oscillates and mode.gain > 0.1]
    assert [mode.whirl for mode in oscillating] == ["none"]
    assert oscillating[0].natural_hz == pytest.approx(106.6, abs=1.0)
