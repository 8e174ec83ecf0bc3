"""Linear models of the plant against closed forms and against the running plant."""

import copy

import numpy as np
import pytest
from scipy import linalg
from scipy.constants import mu_0

from amb_core.ground.errors import ParameterError, PlantError
from amb_core.linear import rates_of
from amb_core.linear.step_response import fit_step_response
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    ConverterParameters,
    IntegrationParameters,
    Linearization,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
    SensorParameters,
    linearize,
)
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.rigid_mode import rigid_pair
from amb_core.plant.simulation import simulate

AVERAGED = AmplifierParameters(switching=False)
AMPLIFIER_OF_BOTH_SIGNS = AmplifierParameters(switching=False, limits=False, unipolar=False)
WITHOUT_GRAVITY = RotorParameters(gravity=0.0)
MASS = 6.25
CENTRE = np.zeros(2)
AREA, AIR_GAP, BIAS, COS = 13.89e-3 * 49.15e-3, 0.6e-3, 3.0, np.cos(np.pi / 8)
CURRENT_GAIN = mu_0 * 100**2 * AREA * BIAS * COS / AIR_GAP**2
"""Closed form for ideal iron (N/A)."""


@pytest.fixture(scope="module")
def paper() -> Linearization:
    return linearize(Plant())


@pytest.fixture(scope="module")
def averaged() -> Linearization:
    return linearize(Plant(PlantParameters(amplifier=AVERAGED)))


def static_gains(model: Linearization) -> tuple[float, float]:
    """Stiffness (N/m) and current gain (N/A) along x: what is left of the force when all but the rotor is at rest."""
    system = model.continuous
    position, velocity = (system.state_names.index(name) for name in ("x", "v_x"))
    inner = [n for n, name in enumerate(system.state_names) if name.startswith(("flux", "integral"))]
    settled = np.linalg.solve(
        system.a[np.ix_(inner, inner)], np.column_stack([system.a[inner, position], system.b[inner, 0]])
    )
    direct = np.array([system.a[velocity, position], system.b[velocity, 0]])
    stiffness, gain = MASS * (direct - system.a[velocity, inner] @ settled)
    return stiffness, gain


@pytest.mark.parametrize(("coupling", "factor"), [(True, 1.0 / COS), (False, COS)])
def test_ideal_iron_gives_the_closed_forms_of_gain_and_negative_stiffness(coupling, factor):
    circuit = MagneticCircuitParameters(relative_permeability=1e12, coupling=coupling)
    model = linearize(Plant(PlantParameters(magnetic_circuit=circuit, rotor=WITHOUT_GRAVITY)))
    stiffness, gain = static_gains(model)
    assert gain == pytest.approx(CURRENT_GAIN, rel=1e-7)
    assert stiffness == pytest.approx(factor * CURRENT_GAIN * BIAS / AIR_GAP, rel=1e-7)


@pytest.mark.parametrize("coupling", [True, False])
def test_one_real_unstable_pole_per_axis_near_the_static_one(coupling):
    plant = Plant(PlantParameters(magnetic_circuit=MagneticCircuitParameters(coupling=coupling), rotor=WITHOUT_GRAVITY))
    model = linearize(plant)
    poles = model.continuous.poles()
    unstable = poles[poles.real > 0.0]
    assert len(unstable) == 2
    assert np.abs(unstable.imag).max() < 1e-6  # two equal ones may come out as a pair
    # Amplifiers and eddy currents answer within 0.02 ms, the pole's time constant is 4 ms.
    np.testing.assert_allclose(unstable.real, np.sqrt(static_gains(model)[0] / MASS), rtol=5e-3)


def test_right_hand_side_vanishes_at_the_operating_point(paper):
    rates = AveragedPlant(Plant()).derivative(paper.point.state, paper.point.current_reference)
    assert np.abs(rates).max() < 1e-8


def test_states_inputs_and_outputs_are_named(paper):
    assert paper.continuous.input_names == paper.discrete.input_names == ("i_x", "i_y")
    assert paper.continuous.output_names == paper.discrete.output_names == ("x", "y")
    assert {"flux_0", "x", "y", "v_x", "v_y", "integral_+x"} <= set(paper.continuous.state_names)
    assert {"x", "v_y", "charge_+x", "integral_-y"} <= set(paper.discrete.state_names)


def test_axes_are_alike_and_decoupled_without_gravity():
    model = linearize(Plant(PlantParameters(rotor=WITHOUT_GRAVITY)))
    for frequency in (0.0, 2 * np.pi * 60.0, 2 * np.pi * 2000.0):
        response = model.continuous.at(1j * frequency)[0]
        assert response[0, 0] == pytest.approx(response[1, 1], rel=1e-6)
        assert np.abs([response[0, 1], response[1, 0]]).max() < 1e-6 * np.abs(response[0, 0])


def test_discrete_poles_without_modulation_are_those_of_the_held_continuous_plant(averaged):
    expected = np.exp(averaged.continuous.poles() * 1e-4)
    np.testing.assert_allclose(np.sort(np.abs(averaged.discrete.poles())), np.sort(np.abs(expected)), atol=1e-12)
    assert averaged.discrete.state_names == averaged.continuous.state_names


def test_sag_is_where_the_running_loop_settles(paper):
    record = simulate(Plant(PlantParameters(amplifier=AVERAGED)), PdController(ControllerParameters()), 2_000)
    # The integral part of the amplifiers needs minutes to settle; it is worth 1 mA, which is 0.05 um.
    np.testing.assert_allclose(paper.point.position, record.position[-1], atol=0.1e-6)
    assert paper.point.position[1] == pytest.approx(-66e-6, abs=4e-6)


def small_signal_error(parameters: PlantParameters, axis: int, samples: int = 40) -> np.ndarray:
    """Response of the running plant to a step of 1 mA over that of the discrete model, minus one."""
    controller, plant = PdController(ControllerParameters()), Plant(parameters)
    for _ in range(1_500):
        held = controller.update(plant.position, (0.0, 0.0))
        plant.advance(held)
    # The loop is open from here; the drift without the step of 1 mA is subtracted.
    other, step = copy.deepcopy(plant), 1e-3 * np.eye(2)[axis]
    model = linearize(plant).discrete
    row, state, ratios = model.output_names.index("xy"[axis]), np.zeros(model.order), []
    for _ in range(samples):
        change = np.subtract(other.advance(held + step), plant.advance(held))
        state = model.a @ state + model.b[:, row] * 1e-3
        ratios.append(change[axis] / (model.c @ state)[row] - 1.0)
    return np.array(ratios)


@pytest.mark.parametrize("axis", [0, 1])
def test_discrete_plant_is_the_running_plant_for_small_currents(axis):
    # Averaged amplifiers of the running plant are sampled once per internal step, 0.5 us.
    error = small_signal_error(PlantParameters(amplifier=AVERAGED), axis)
    assert np.abs(error[5:]).max() < 5e-3


MODULATED = {
    "paper": {},
    "50 kHz": {"amplifier": AmplifierParameters(switching_frequency=50e3)},
    "20 kHz": {"amplifier": AmplifierParameters(switching_frequency=20e3, proportional_gain=0.3)},
    "interleaved": {
        "amplifier": AmplifierParameters(switching_frequency=50e3, carriers="interleaved", proportional_gain=0.5)
    },
    "delay, no integral part": {
        "amplifier": AmplifierParameters(switching_frequency=50e3, proportional_gain=0.5, integral_gain=0.0),
        "converters": ConverterParameters(computation_delay=0.33),
    },
    "1 DOF, sensor": {
        "amplifier": AmplifierParameters(switching_frequency=50e3, proportional_gain=0.5, integral_gain=100.0),
        "magnetic_circuit": MagneticCircuitParameters(actuators="differential"),
        "sensor": SensorParameters(bandwidth=5_000.0),
    },
}


@pytest.mark.parametrize("name", MODULATED)
def test_discrete_plant_has_the_sampling_of_the_modulation(name):
    """Without it the first sample is wrong by 10 to 37 %; where in the period the pulse lies is left out, 1.2 %."""
    error = small_signal_error(PlantParameters(**MODULATED[name]), axis=1)
    assert np.abs(error[0]) < 0.015
    assert np.abs(error[1:]).max() < 4e-3


def test_modulation_that_does_not_fit_the_samples_is_averaged():
    amplifier = AmplifierParameters(switching_frequency=12.5e3, proportional_gain=0.1)
    model = linearize(Plant(PlantParameters(amplifier=amplifier)))
    assert model.discrete.state_names == model.continuous.state_names


@pytest.mark.parametrize("settings", [{}, {"derivative_filter": 2e-4}, {"derivative_on": "measurement"}])
def test_closed_loop_is_the_running_loop_for_small_references(settings):
    parameters = ControllerParameters(**settings)
    plant = Plant(PlantParameters(amplifier=AVERAGED))
    excitation = np.tile([0.1e-6, -0.05e-6], (300, 1))
    still, moved = (
        simulate(plant, PdController(parameters), 2_300, signal, 2_000).position[2_000:]
        for signal in (None, excitation)
    )
    loop = linearize(plant, parameters).closed_loop
    state = np.zeros(loop.order)
    for sample in moved - still:
        np.testing.assert_allclose(sample, loop.c @ state, atol=3e-3 * 0.15e-6)
        state = loop.a @ state + loop.b @ excitation[0]


def test_modes_of_the_loop_are_those_fitted_to_its_step_response(paper):
    excitation = np.zeros((2_000, 2))
    excitation[:, 0] = 0.2e-6
    plant = Plant(PlantParameters(amplifier=AVERAGED))
    record = simulate(plant, PdController(ControllerParameters()), 4_000, excitation, 2_000)
    fitted = fit_step_response(record.position[2_000:, 0], record.sample_time)
    mode = paper.rigid_mode("x")
    assert mode.natural_hz == pytest.approx(fitted.natural_hz, rel=5e-3)
    assert mode.damping_ratio == pytest.approx(fitted.damping_ratio, rel=1e-2)
    assert mode.natural_hz == pytest.approx(63.0, abs=1.0)


def test_sensitivity_is_that_of_plant_and_controller_in_series(paper):
    controller = ControllerParameters()
    assert paper.stable
    peaks = []
    for frequency in np.geomspace(20.0, 2_000.0, 200):
        z = np.exp(2j * np.pi * frequency * 1e-4)
        law = controller.proportional_gain + controller.derivative_gain * (1.0 - 1.0 / z) / 1e-4
        expected = np.linalg.inv(np.eye(2) + paper.discrete.at(z)[0] * law)
        np.testing.assert_allclose(paper.sensitivity.at(z)[0], expected, rtol=1e-6, atol=1e-9)
        peaks.append(np.linalg.norm(expected, 2))
    assert paper.peak_sensitivity == pytest.approx(max(peaks), rel=1e-3)


def rates(model: Linearization) -> np.ndarray:
    """Poles of the closed loop in 1/s, shape (n,); z = 0 has the rate -inf."""
    return rates_of(model.closed_loop.poles(), model.closed_loop.sample_time)


def test_loop_with_too_little_gain_is_unstable():
    # Its equilibrium at the centre exists without gravity, but K_P k_i < k_s.
    model = linearize(Plant(PlantParameters(rotor=WITHOUT_GRAVITY)), ControllerParameters(proportional_gain=4_000.0))
    assert not model.stable
    assert rates(model).real.max() > 0.0


def test_amplifier_without_integral_part_has_no_such_states():
    plant = Plant(PlantParameters(amplifier=AmplifierParameters(integral_gain=0.0)))
    model = linearize(plant)
    assert not [name for name in model.continuous.state_names if name.startswith("integral")]
    assert np.abs(AveragedPlant(plant).derivative(model.point.state, model.point.current_reference)).max() < 1e-8


@pytest.mark.parametrize("integral_gain", [0.0, 0.01])
@pytest.mark.parametrize("dead_time", [0.0, 1e-6])
def test_bipolar_amplifiers_are_at_rest_with_a_negative_coil_current(integral_gain, dead_time):
    amplifier = AMPLIFIER_OF_BOTH_SIGNS.model_copy(update={"integral_gain": integral_gain, "dead_time": dead_time})
    circuit = MagneticCircuitParameters(coil_resistance=5.0)
    plant = Plant(PlantParameters(amplifier=amplifier, magnetic_circuit=circuit, rotor=RotorParameters(mass=18.0)))
    point = linearize(plant, ControllerParameters(proportional_gain=4e4, current_limit=50.0)).point
    averaged = AveragedPlant(plant)
    assert averaged.currents(point.state, point.current_reference).min() < -0.1
    assert np.abs(averaged.derivative(point.state, point.current_reference)).max() < 1e-8


def test_a_given_position_is_held_by_the_currents_found():
    model = linearize(Plant(), position=np.array([20e-6, -30e-6]))
    np.testing.assert_allclose(model.point.position, [20e-6, -30e-6])
    assert np.abs(AveragedPlant(Plant()).derivative(model.point.state, model.point.current_reference)).max() < 1e-8


@pytest.mark.parametrize("model", ["point_mass", "rigid"])
@pytest.mark.parametrize("force", [(0.0, -25.0), (0.0, 40.0), (15.0, 61.3125)])
def test_a_constant_force_holds_the_rotor_where_the_running_plant_settles(model, force):
    """It acts at bearing A; the last one carries the weight of half a rotor."""
    rotor = RotorParameters(model=model, external_force_x=force[0], external_force_y=force[1])
    plant = Plant(PlantParameters(amplifier=AVERAGED.model_copy(update={"integral_gain": 100.0}), rotor=rotor))
    point = linearize(plant).point
    settled = simulate(plant, PdController(ControllerParameters(), len(plant.machine.axes)), 4_000).position[-1]
    np.testing.assert_allclose(point.journals, settled, atol=1e-11)
    unloaded = linearize(Plant(PlantParameters(amplifier=AVERAGED, rotor=RotorParameters(model=model)))).point
    assert np.abs(point.journals - unloaded.journals)[1] > 20e-6


def test_a_position_is_held_against_a_constant_force_by_the_currents_found():
    without, pushed = (
        linearize(Plant(PlantParameters(rotor=RotorParameters(gravity=0.0, external_force_y=force))), position=CENTRE)
        for force in (0.0, 150.0)
    )
    np.testing.assert_allclose(without.point.current_reference, 0.0, atol=1e-9)
    assert pushed.point.current_reference == pytest.approx([0.0, -150.0 / CURRENT_GAIN], rel=0.1, abs=1e-9)


def test_an_alternating_force_leaves_the_operating_point():
    rotor = RotorParameters(external_force_y=40.0, external_force_frequency=50.0)
    assert (
        linearize(Plant(PlantParameters(rotor=rotor))).point.position.tolist()
        == linearize(Plant()).point.position.tolist()
    )


def test_position_outside_the_backup_bearing_is_refused():
    with pytest.raises(
        PlantError, match=r"position 0\.0003 m, 0 m is not inside the backup bearing; allowed: less than"
    ):
        linearize(Plant(), position=np.array([300e-6, 0.0]))


def test_rotor_too_heavy_for_the_currents_is_refused():
    heavy = Plant(PlantParameters(rotor=RotorParameters(mass=1_000.0)))
    with pytest.raises(PlantError, match="no control current holds the rotor"):
        linearize(heavy, position=np.zeros(2))
    with pytest.raises(PlantError, match="cannot hold the rotor of 1000 kg inside the backup bearing"):
        linearize(heavy)


def test_a_force_beyond_the_currents_is_refused_by_its_name():
    pushed = Plant(PlantParameters(rotor=RotorParameters(external_force_y=-2_000.0)))
    against = "against an external force of 0 N, -2000 N"
    with pytest.raises(PlantError, match=f"within the amplifiers' limit of 10 A, {against}"):
        linearize(pushed, position=CENTRE)
    with pytest.raises(PlantError, match=rf"inside the backup bearing, 0\.00025 m, {against}"):
        linearize(pushed)


def test_operating_point_beyond_a_limit_is_refused():
    with pytest.raises(
        PlantError, match=r"needs a control current of 1\.36 A; allowed: less than the controller's limit"
    ):
        linearize(Plant(), ControllerParameters(current_limit=1.0))
    resistive = Plant(PlantParameters(magnetic_circuit=MagneticCircuitParameters(coil_resistance=50.0)))
    with pytest.raises(PlantError, match=r"through 50 ohm, a duty cycle of 0\.864; allowed: less than 0\.75"):
        linearize(resistive)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_rigid_mode_of_an_overdamped_loop_has_two_real_poles(gravity):
    """Four times the damping of the paper's loop; the natural frequency changes little with damping."""
    model = linearize(
        Plant(PlantParameters(rotor=RotorParameters(gravity=gravity))), ControllerParameters(derivative_gain=150.0)
    )
    for axis in "xy":
        mode = model.rigid_mode(axis)
        assert mode.natural_hz == pytest.approx(65.0, abs=4.0)
        assert mode.damping_ratio == pytest.approx(0.49 * 150.0 / 38.0, rel=0.15)


def test_equal_real_poles_that_rounding_makes_complex_are_those_of_the_rigid_mode():
    """Axes alike have equal poles; what couples them by the last bits, as gyroscopic forces do, makes complex pairs."""
    plant = Plant(PlantParameters(rotor=RotorParameters(gravity=0.0)))
    loop = linearize(plant, ControllerParameters(derivative_gain=150.0)).closed_loop
    across, coupled = [loop.state_names.index(name) for name in ("v_x", "v_y")], copy.deepcopy(loop)
    coupled.a[across, across[::-1]] += 1e-10, -1e-10
    split = np.abs(linalg.eigvals(coupled.a).imag)
    assert np.any((split > 0.0) & (split < 1e-9))
    pair = rigid_pair(coupled, "x")
    assert pair == pytest.approx(rigid_pair(loop, "x"), rel=1e-6)
    assert np.sqrt(np.prod(pair).real) / (2.0 * np.pi) == pytest.approx(65.0, abs=4.0)


def test_a_rotor_pole_that_has_met_an_amplifier_pole_makes_no_rigid_mode():
    slow = AmplifierParameters(proportional_gain=0.1)
    controller = ControllerParameters(proportional_gain=5e4, derivative_gain=150.0, derivative_filter=1e-4)
    model = linearize(Plant(PlantParameters(amplifier=slow)), controller)
    oscillating = np.abs(rates(model)[rates(model).imag > 0.0]).min()
    assert 300.0 < oscillating / (2.0 * np.pi) < 500.0
    assert model.rigid_mode("x") is None


def test_poles_at_the_origin_have_no_finite_rate():
    # Without derivative gain the difference is computed for nothing: two poles at z = 0.
    loop = linearize(Plant(), ControllerParameters(derivative_gain=0.0))
    assert np.isneginf(rates(loop).real).sum() == 2
    assert not loop.stable
    assert loop.rigid_mode("x").damping_ratio < 0.0


def test_a_controller_of_another_sample_rate_is_refused() -> None:
    plant = Plant(PlantParameters(integration=IntegrationParameters(sample_rate=20_000.0)))
    said = "controller runs at 10000 Hz, the plant is sampled at 20000 Hz; the two rates must be equal"
    with pytest.raises(ParameterError, match=said):
        linearize(plant)
    with pytest.raises(ParameterError, match=said):
        simulate(plant, PdController(ControllerParameters()), 10)
