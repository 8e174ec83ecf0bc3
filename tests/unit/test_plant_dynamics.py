"""The running plant: amplifiers, conservation laws, order of the integrator, and its limits."""

import itertools

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
    Trace,
)
from amb_core.plant.closed_forms import current_gain, inductance, negative_stiffness
from amb_core.plant.simulation import simulate
from tests.validation.energy import EnergyAccount


def joined(traces: list[Trace]) -> dict[str, np.ndarray]:
    return {
        name: np.concatenate([getattr(trace, name) for trace in traces])
        for name in ("flux", "flux_rate", "current", "voltage", "position", "velocity", "force")
    }


def shaken(plant: Plant, samples: int = 200) -> dict[str, np.ndarray]:
    """Internal steps of a closed loop under a 10 um square wave on both axes."""
    controller = PdController(ControllerParameters(sample_rate=plant.parameters.integration.sample_rate))
    traces = []
    for step in range(samples):
        reference = 10e-6 if (step // 40) % 2 == 0 else -10e-6
        traces.append(plant.trace(controller.update(plant.position, (reference, reference))))
    return joined(traces)


def test_flux_is_conserved_at_every_internal_step():
    steps = shaken(Plant())
    assert np.abs(steps["flux"].sum(axis=1)).max() < 1e-12 * np.abs(steps["flux"]).max()


def test_energy_of_the_amplifiers_is_lost_stored_or_done_as_work_on_the_rotor():
    plant, controller = Plant(), PdController(ControllerParameters())
    account = EnergyAccount(plant)
    for step in range(200):
        reference = 10e-6 if (step // 40) % 2 == 0 else -10e-6
        account.add(plant.trace(controller.update(plant.position, (reference, reference))))
    assert min(account.electrical, account.copper, account.eddy) > 0
    balance = account.copper + account.eddy + account.stored + account.mechanical
    assert account.electrical == pytest.approx(balance, rel=1e-3)
    assert account.mechanical == pytest.approx(account.kinetic + account.potential, rel=1e-3)


def test_error_falls_at_least_in_proportion_to_the_internal_step():
    def final_position(step: float) -> np.ndarray:
        plant = Plant(PlantParameters(integration=IntegrationParameters(internal_step=step)))
        for sample in range(30):
            plant.advance((0.5 if sample < 15 else -0.5, 1.36))
        return np.array(plant.position)

    positions = [final_position(step) for step in (1e-6, 0.5e-6, 0.25e-6, 0.125e-6)]
    changes = [np.linalg.norm(coarse - fine) for coarse, fine in itertools.pairwise(positions)]
    # Where in a step the switching instants fall makes single halvings uneven, so two are taken together.
    assert changes[0] / changes[2] > 4.0
    assert changes[1] < 1e-10


@pytest.mark.parametrize("model", ["point_mass", "rigid"])
@pytest.mark.parametrize("running_speed", [0.0, 100.0])
def test_plant_moves_the_same_whether_its_internal_steps_are_recorded_or_not(model, running_speed):
    """A recorded plant runs in the general loop, others have loops of their own."""
    parameters = PlantParameters(rotor=RotorParameters(model=model, running_speed=running_speed, unbalance=1e-6))
    recorded, plant = Plant(parameters), Plant(parameters)
    controller = PdController(ControllerParameters(), len(plant.machine.axes))
    for step in range(100):
        reference = np.full(len(plant.machine.axes), 10e-6 if step < 50 else -10e-6)
        currents = controller.update(plant.position, reference)
        recorded.trace(currents)
        assert plant.advance(currents) == recorded.position


def test_current_slews_at_the_limited_duty_over_the_inductance():
    plant = Plant(
        PlantParameters(
            magnetic_circuit=MagneticCircuitParameters(relative_permeability=1e12, coupling=False, coil_resistance=0.0),
            rotor=RotorParameters(mass=1e5),
        )
    )
    steps = joined([plant.trace((3.0, 0.0))])
    average_voltage = (2 * 0.75 - 1) * 300.0
    one_period = slice(100, 121, 20)  # the same instant of consecutive switching periods: no ripple
    slew = np.diff(steps["current"][one_period, 0])[0] / 10e-6
    assert slew == pytest.approx(average_voltage / inductance(plant.parameters.magnetic_circuit), rel=1e-3)
    assert slew == pytest.approx(2.1e4, rel=5e-3)


def test_mean_coil_currents_follow_their_references():
    plant = Plant(PlantParameters(rotor=RotorParameters(mass=1e5, gravity=0.0)))
    plant.trace((0.4, -0.2), samples=5)
    settled = plant.trace((0.4, -0.2), samples=5)
    # a current error of 1 mA makes the 0.6 V that the resistance takes
    np.testing.assert_allclose(settled.current.mean(axis=0), [3.4, 2.8, 2.6, 3.2], atol=2e-3)


def test_averaged_amplifiers_have_the_same_mean_currents_without_ripple():
    parameters = PlantParameters(rotor=RotorParameters(mass=1e5, gravity=0.0))
    averaged = parameters.model_copy(update={"amplifier": AmplifierParameters(switching=False)})
    ripples, means = [], []
    for variant in (parameters, averaged):
        plant = Plant(variant)
        plant.trace((0.4, -0.2), samples=5)
        current = plant.trace((0.4, -0.2), samples=5).current
        ripples.append(np.ptp(current, axis=0).max())
        means.append(current.mean(axis=0))
    assert ripples[0] > 0.2 > 0.01 > ripples[1]
    np.testing.assert_allclose(means[0], means[1], atol=2e-3)


def test_coil_current_never_becomes_negative():
    plant = Plant(PlantParameters(rotor=RotorParameters(mass=1e5, gravity=0.0)))
    steps = joined([plant.trace((-5.0, 5.0), samples=10)])
    assert steps["current"].min() > -1e-9
    assert steps["current"][-1, 0] == pytest.approx(0.0, abs=1e-3)
    assert steps["current"][-1, 2] == pytest.approx(8.0, abs=0.3)


def test_without_the_polarity_effect_the_same_command_drives_it_negative():
    plant = Plant(
        PlantParameters(rotor=RotorParameters(mass=1e5, gravity=0.0), amplifier=AmplifierParameters(unipolar=False))
    )
    assert joined([plant.trace((-5.0, 0.0), samples=10)])["current"].min() < -0.01


def test_coil_current_reference_is_limited():
    plant = Plant(PlantParameters(rotor=RotorParameters(mass=1e5, gravity=0.0)))
    settled = [plant.trace((50.0, 0.0), samples=20) for _ in range(2)][-1]
    assert settled.current[:, 0].mean() == pytest.approx(10.0, abs=0.01)


def test_small_sag_is_weight_over_closed_loop_stiffness():
    # The linearised, iron-free limit: k_i K_P - k_s.
    gravity = 0.0981
    plant = Plant(
        PlantParameters(
            magnetic_circuit=MagneticCircuitParameters(relative_permeability=1e12),
            rotor=RotorParameters(gravity=gravity),
        )
    )
    record = simulate(plant, PdController(ControllerParameters()), 3000)
    circuit = plant.parameters.magnetic_circuit
    stiffness = current_gain(circuit, 3.0) * 20_000 - negative_stiffness(circuit, 3.0)
    assert -record.position[-500:, 1].mean() == pytest.approx(6.25 * gravity / stiffness, rel=2e-3)


def test_paper_bearing_sags_66_micrometres():
    record = simulate(Plant(), PdController(ControllerParameters()), 2000)
    assert -record.position[-500:, 1].mean() == pytest.approx(66e-6, abs=4e-6)


def test_symmetric_bearing_without_gravity_stays_centred():
    plant = Plant(PlantParameters(rotor=RotorParameters(gravity=0.0)))
    record = simulate(plant, PdController(ControllerParameters()), 500)
    assert np.abs(record.position).max() < 1e-12


def test_two_runs_give_identical_samples():
    plant, controller = Plant(), PdController(ControllerParameters())
    excitation = np.full((300, 2), 20e-6)
    first = simulate(plant, controller, 500, excitation, 100)
    assert simulate(plant, controller, 500, excitation, 100).identical_to(first)


def test_rotor_without_control_delevitates_and_says_so():
    plant = Plant()
    for _ in range(400):
        plant.advance((0.0, 0.0))
        if plant.delevitated:
            break
    assert plant.delevitated
    assert np.hypot(*plant.position) >= 250e-6
    with pytest.raises(PlantError, match="delevitated at sample"):
        plant.advance((0.0, 0.0))
    plant.reset()
    plant.advance((0.0, 0.0))


def test_reference_that_is_not_finite_is_refused_before_it_reaches_the_state():
    plant = Plant()
    with pytest.raises(PlantError, match=r"references nan, 0 A not finite at sample 1,"):
        plant.advance((float("nan"), 0.0))


def test_state_that_is_not_finite_is_an_error_naming_state_and_sample():
    plant = Plant()
    plant._arrays.bearings[0]["flux"][0] = np.inf  # no input leads there: only a broken model would
    with pytest.raises(PlantError, match=r"state not finite \(flux, rotor\) at sample 1"):
        plant.advance((0.0, 0.0))


def test_internal_step_too_long_for_the_eddy_currents_is_refused():
    with pytest.raises(PlantError, match="internal_step = 5e-06 s is too long for the eddy currents"):
        Plant(PlantParameters(integration=IntegrationParameters(internal_step=5e-6)))
