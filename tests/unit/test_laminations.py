"""Diffusion of flux into laminations: its terms, the running plant against closed forms, and what the choice costs."""

import pickle

import numpy as np
import pytest
from scipy.integrate import quad

from amb_core.ground.errors import ParameterError, PlantError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import MagneticCircuitParameters, Plant, PlantParameters, describe, linearize
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.eddy import diffusion, eddy_bandwidth, lamination_terms, lamination_time_constant
from amb_core.plant.switching_loss import switching_loss
from tests.validation.energy import EnergyAccount

DIFFUSION = {"iron.laminations": "diffusion"}
SATURATION = {"iron.saturation": True}
HYSTERESIS = {"iron.saturation": True, "iron.hysteresis": True}
HELD = {"rotor.mass": 1e5, "rotor.gravity": 0.0}


def parameters_with(**values) -> PlantParameters:
    return validate(PlantParameters, values)


def laminations(thickness: float = 0.35e-3, permeability: float = 4000.0, conductivity: float = 2e6):
    circuit = MagneticCircuitParameters(
        lamination_thickness=thickness, relative_permeability=permeability, iron_conductivity=conductivity
    )
    return lamination_terms(PlantParameters(magnetic_circuit=circuit))


# -- the terms


def test_five_terms_hold_half_a_percent_up_to_1_mhz():
    terms = laminations()
    assert len(terms.rates) == 5
    assert np.abs(terms.error(np.geomspace(1.0, 1e6, 3000))).max() < 0.005


def test_laminations_of_any_kind_are_held_within_half_a_percent_by_passive_terms():
    rng = np.random.default_rng(13)
    frequency = np.geomspace(1e-3, 1e6, 500)
    for thickness, permeability, conductivity in 10.0 ** rng.uniform([-5.0, 0.0, 3.0], [-2.31, 6.0, 8.0], (50, 3)):
        terms = laminations(thickness, permeability, conductivity)
        assert np.abs(terms.error(frequency)).max() <= 0.00505
        assert np.all(terms.weights > 0.0)
        assert terms.rest > 0.0


def test_beyond_1_mhz_the_drop_becomes_too_large():
    at_2, at_5, at_10_mhz = np.abs(laminations().error(np.array([2e6, 5e6, 10e6])))
    assert 0.01 < at_2 < 0.05
    assert at_5 < 0.2
    assert at_10_mhz < 0.45


def test_thin_laminations_are_the_limit_of_low_frequencies_only():
    tau = lamination_time_constant(PlantParameters())
    limit = 1.0 / (2.0 * np.pi * tau)
    assert limit == pytest.approx(517.0, abs=1.0)
    thin_over_exact = [abs((1.0 + 2j * np.pi * f * tau / 3.0) / diffusion(np.array([f]), tau)[0]) for f in (limit, 1e6)]
    assert thin_over_exact[0] == pytest.approx(1.0, abs=0.02)
    assert thin_over_exact[1] > 14.0


@pytest.mark.parametrize("step", [1e-8, 0.5e-6, 1e-5])
def test_mean_over_a_step_is_that_of_memories_under_a_constant_rate(step):
    terms, start, rate = laminations(), 0.3, 2.0
    shares, coefficient = terms.mean(step)

    def drop(time: float) -> float:
        decay = np.exp(-terms.rates * time)
        return float(np.sum(start * decay + terms.weights / terms.rates * (1.0 - decay) * rate)) + terms.rest * rate

    expected = quad(drop, 0.0, step, epsabs=0.0, epsrel=1e-11)[0] / step
    assert start * shares.sum() + coefficient * rate == pytest.approx(expected, rel=1e-9)


# -- force, impedance and loss against closed forms


def test_force_falls_by_3_db_at_four_times_the_frequency_of_thin_laminations():
    assert eddy_bandwidth(parameters_with()) == pytest.approx(59.1e3, rel=1e-3)
    assert eddy_bandwidth(parameters_with(**DIFFUSION)) == pytest.approx(234e3, rel=1e-3)


def linkage_per_current(frequency: float, steps_per_period: int, **values) -> complex:
    """Flux linkage over coil current of a running plant at its switching frequency, relative to the closed form.

    All coils see the same square wave, so each pole drives its own flux and half of it each way through the rings.
    """
    rate = min(frequency, 1e4)
    plant = Plant(
        parameters_with(
            **DIFFUSION,
            **HELD,
            **values,
            **{
                "magnetic_circuit.coil_resistance": 0.0,
                "amplifier.switching_frequency": frequency,
                "amplifier.proportional_gain": 0.0,
                "amplifier.integral_gain": 0.0,
                "amplifier.unipolar": False,
                "integration.sample_rate": rate,
                "integration.internal_step": 1.0 / (frequency * steps_per_period),
            },
        )
    )
    for _ in range(int(np.ceil(4e-4 * rate))):  # ten times the slowest term
        plant.advance((0.0, 0.0))
    trace = plant.trace((0.0, 0.0))
    current = trace.current[-steps_per_period - 1 : -1, 0]
    flux = (0.5 * (trace.flux[1:] + trace.flux[:-1]))[-steps_per_period:]
    network, circuit = plant.network, plant.parameters.magnetic_circuit
    linked = flux @ network.winding[:, 0]
    pattern = np.sign(network.winding.sum(axis=1))
    iron = pattern @ network.iron_reluctance @ pattern / 8.0
    drop = circuit.air_gap * network.gap_reluctance + iron * diffusion(
        np.array([frequency]), lamination_time_constant(plant.parameters)
    )
    expected = 2.0 * circuit.turns_per_pole**2 / drop[0]
    return complex(np.fft.fft(linked)[1] / np.fft.fft(current)[1] / expected)


@pytest.mark.parametrize("coupling", [True, False])
@pytest.mark.parametrize(("frequency", "steps"), [(1e3, 500), (10e3, 200), (100e3, 50), (300e3, 50), (1e6, 50)])
def test_running_plant_is_within_1_percent_of_the_closed_form_up_to_1_mhz(frequency, steps, coupling):
    values = {"magnetic_circuit.coupling": coupling}
    assert abs(linkage_per_current(frequency, steps, **values) - 1.0) < 0.01


def test_default_step_is_within_1_percent_at_the_switching_frequency():
    assert abs(linkage_per_current(100e3, 20) - 1.0) < 0.01


def run(samples: int = 40, **values) -> tuple[EnergyAccount, float]:
    """Energies of a levitated bearing after it has settled, and the time over which they were summed (s)."""
    plant = Plant(parameters_with(**values))
    axes = len(plant.position)
    controller, centre = PdController(ControllerParameters(), axes), (0.0,) * axes
    for _ in range(60):
        plant.advance(controller.update(plant.position, centre))
    account = EnergyAccount(plant)
    for _ in range(samples):
        account.add(plant.trace(controller.update(plant.position, centre)))
    return account, samples * plant.sample_time


def test_loss_by_switching_is_that_of_diffusion_and_a_seventh_of_that_of_thin_laminations():
    thin, thin_time = run()
    exact, exact_time = run(**DIFFUSION)
    assert thin.eddy / thin_time == pytest.approx(switching_loss(parameters_with()), rel=0.01)
    assert exact.diffusion / exact_time == pytest.approx(switching_loss(parameters_with(**DIFFUSION)), rel=0.01)
    assert switching_loss(parameters_with()) == pytest.approx(121.0, rel=1e-3)
    assert switching_loss(parameters_with(**DIFFUSION)) == pytest.approx(16.53, rel=1e-3)


def test_description_says_what_thin_laminations_do_to_the_loss():
    thin, exact = describe(parameters_with()), describe(parameters_with(**DIFFUSION))
    assert thin.switching_loss == pytest.approx(7.32 * thin.switching_loss_diffusion, rel=1e-2)
    assert exact.switching_loss == exact.switching_loss_diffusion == thin.switching_loss_diffusion
    assert exact.eddy_time_constant == pytest.approx(thin.eddy_time_constant, rel=0.01)


def test_without_pulses_or_eddy_currents_switching_loses_nothing():
    assert switching_loss(parameters_with(**{"amplifier.switching": False})) == 0.0
    assert switching_loss(parameters_with(**{"iron.eddy_currents": False})) == 0.0


# -- the running plant


@pytest.mark.parametrize(
    ("values", "share"),
    [
        ({}, 1e-5),
        ({"iron.solid_journal": True, "amplifier.proportional_gain": 0.4}, 1e-5),
        (SATURATION, 3e-4),
        (HYSTERESIS, 3e-4),
        ({"rotor.model": "rigid"}, 1e-5),
        ({"amplifier.carriers": "interleaved", "amplifier.dead_time": 0.3e-6}, 1e-4),
        ({"magnetic_circuit.actuators": "differential"}, 1e-4),
    ],
    ids=["line", "solid journal", "curve", "loops", "two bearings", "carriers", "one axis"],
)
def test_energy_of_the_amplifiers_is_lost_stored_or_done_as_work(values, share):
    account, _ = run(**DIFFUSION, **values)
    assert account.eddy == 0.0
    assert account.diffusion > 0.5 * account.copper
    assert abs(account.circuit_residual) < share * account.electrical


def test_position_hardly_notices_the_choice():
    positions = []
    for values in ({}, DIFFUSION):
        plant, controller = Plant(parameters_with(**values)), PdController(ControllerParameters())
        for sample in range(300):
            plant.advance(controller.update(plant.position, (0.0, 10e-6 if sample < 150 else -10e-6)))
        positions.append(plant.position[1])
    assert positions[0] != positions[1]
    assert positions[1] == pytest.approx(positions[0], abs=20e-9)


def test_no_current_becomes_negative():
    plant = Plant(parameters_with(**DIFFUSION, **HELD))
    trace = plant.trace((3.0, 0.0), samples=5)  # the reference of -x is zero
    assert trace.current[:, 2].min() > -1e-6
    assert trace.current[-400:, 2].mean() == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("iron", [SATURATION, HYSTERESIS], ids=["curve", "loops"])
def test_deep_saturation_stays_finite_and_ends_where_the_curve_says(iron):
    plant = Plant(parameters_with(**DIFFUSION, **HELD, **iron, **{"amplifier.current_limit": 23.0}))
    for _ in range(100):
        plant.advance((20.0, 0.0))
    last = plant.trace((20.0, 0.0))
    at_rest = plant.magnetostatics.solve(last.current.mean(axis=0), *last.position[-1])
    largest = np.abs(at_rest.flux).max()
    assert largest / plant.network.pole_area > 1.4  # T
    assert np.abs(last.flux_rate).max() < 10.0  # V per turn, of which the voltage gives 3: nothing runs away
    np.testing.assert_allclose(last.flux.mean(axis=0), at_rest.flux, atol=0.05 * largest)


@pytest.mark.parametrize("values", [{}, HYSTERESIS | {"iron.solid_journal": True, "amplifier.proportional_gain": 0.4}])
def test_copies_and_resets_move_as_the_original(values):
    plant = Plant(parameters_with(**DIFFUSION, **values))
    first = [plant.advance((0.5, 1.0)) for _ in range(5)]
    copy = pickle.loads(pickle.dumps(plant))
    following = [plant.advance((-0.5, 1.0)) for _ in range(5)]
    assert [copy.advance((-0.5, 1.0)) for _ in range(5)] == following
    plant.reset()
    assert [plant.advance((0.5, 1.0)) for _ in range(5)] == first


def test_linear_model_has_the_diffusion():
    """Its poles are those of the same terms; the rotor's mode is that of thin laminations within 0.1 %."""
    plant = Plant(parameters_with(**DIFFUSION))
    averaged = AveragedPlant(plant)
    terms = plant.network.diffusing[0].terms
    assert averaged.size == AveragedPlant(Plant(parameters_with())).size + 8 * len(terms.rates)
    exact, thin = linearize(plant).rigid_mode("x"), linearize(Plant(parameters_with())).rigid_mode("x")
    assert exact is not None
    assert thin is not None
    assert exact.natural_hz == pytest.approx(thin.natural_hz, rel=1e-3)
    assert exact.damping_ratio == pytest.approx(thin.damping_ratio, rel=2e-3)


def test_diffusion_without_eddy_currents_is_refused():
    with pytest.raises(ParameterError, match=r"laminations = 'diffusion' and iron\.eddy_currents is off.*thin"):
        parameters_with(**DIFFUSION, **{"iron.eddy_currents": False})


def test_a_step_too_long_for_laminations_that_hardly_delay_the_flux_is_refused():
    with pytest.raises(PlantError, match="internal_step = 5e-07 s is too long for the diffusion of flux into lamin"):
        Plant(parameters_with(**DIFFUSION, **{"magnetic_circuit.lamination_thickness": 2e-5}))
