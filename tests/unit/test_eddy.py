"""Eddy currents: the terms of a solid journal and the closed form of the force response."""

import numpy as np
import pytest
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant import AmplifierParameters, IntegrationParameters, MagneticCircuitParameters, Plant, PlantParameters
from amb_core.plant.closed_forms import current_gain
from amb_core.plant.eddy import diffusion, eddy_bandwidth, force_response, solid_journal_terms
from amb_core.plant.network import COIL_AXES, COILS, POLE_ANGLES, POLES, flux_constraints
from amb_core.plant.parameters import IronParameters


def journal(internal_step: float = 0.5e-6, conductivity: float = 5e6, **circuit: float):
    return solid_journal_terms(
        PlantParameters(
            magnetic_circuit=MagneticCircuitParameters(**circuit),
            iron=IronParameters(journal_conductivity=conductivity),
            integration=IntegrationParameters(internal_step=internal_step),
        )
    )


def test_diffusion_is_that_of_a_slab_at_rest_slow_and_fast():
    tau = 9.0
    slow, fast = 1e-4, 1e4
    assert diffusion(np.array([0.0]), tau)[0] == 1.0
    assert diffusion(np.array([slow]), tau)[0] == pytest.approx(1.0 + 2j * np.pi * slow * tau / 3.0, abs=1e-5)
    assert diffusion(np.array([fast]), tau)[0] == pytest.approx(np.sqrt(2j * np.pi * fast * tau), rel=1e-9)


def test_diffusion_is_the_sum_over_its_modes():
    tau, s = 2.0, 2j * np.pi * 3.0
    n = np.arange(1, 2_000_001)
    modes = 1.0 + 2.0 * np.sum(s * tau / (s * tau + (n * np.pi) ** 2))
    assert diffusion(np.array([3.0]), tau)[0] == pytest.approx(modes, rel=1e-5)


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({}, 10),
        ({"internal_step": 0.1e-6}, 11),
        ({"relative_permeability": 1.0}, 8),  # non-magnetic: tau is milliseconds
        ({"journal_inner_radius": 33.95e-3}, 8),  # 1 mm deep
        ({"conductivity": 6e7, "relative_permeability": 1e5}, 14),
        ({"relative_permeability": 1e12}, 24),  # ideal iron: no drop, but no failure either
    ],
)
def test_few_passive_terms_hold_half_a_percent_and_half_a_degree(options, most):
    terms = journal(**options)
    frequency = np.concatenate([[0.0], np.geomspace(1e-6, terms.highest_frequency, 3000)])
    ratio = 1.0 + terms.error(frequency)
    assert len(terms.rates) <= most
    assert np.all(terms.weights > 0.0)
    assert terms.rest > 0.0
    assert np.abs(np.abs(ratio) - 1.0).max() < 0.0051
    assert np.abs(np.angle(ratio, deg=True)).max() < 0.3


def test_terms_reach_100_khz_where_the_internal_step_resolves_it():
    assert journal(internal_step=0.1e-6).highest_frequency == 100e3
    assert journal(internal_step=0.5e-6).highest_frequency == pytest.approx(33.3e3, rel=0.01)


def test_error_grows_slowly_above_the_highest_frequency():
    terms = journal()
    assert np.abs(terms.error(np.array([100e3])))[0] < 0.1
    assert np.abs(terms.error(np.array([300e3])))[0] < 0.4


@pytest.mark.parametrize("internal_step", [0.25e-6, 0.5e-6, 1e-6])
def test_shortest_time_constant_is_two_internal_steps(internal_step):
    terms = journal(internal_step)
    assert terms.rest / (1.0 + terms.weights.sum()) > 2.0 * internal_step


def test_a_journal_thinner_than_its_skin_depth_needs_the_rest_only():
    terms = journal(conductivity=1e3, relative_permeability=1.0, journal_inner_radius=34.9e-3)
    assert len(terms.rates) == 0
    assert terms.rest == pytest.approx(terms.time_constant / 3.0, rel=1e-6)


def run_terms(terms, flux, step):
    """Sum of the memories after each step of a sampled flux that starts from rest."""
    keep, gain = terms.update(step)
    memory = np.zeros(len(terms.rates))
    sums = [0.0]
    for change in np.diff(flux):
        memory = keep * memory + gain * change
        sums.append(memory.sum())
    return np.array(sums)


def test_recursion_is_exact_for_a_ramp_whatever_the_step():
    terms, end = journal(), 1e-3
    expected = np.sum(terms.weights * -np.expm1(-terms.rates * end) / terms.rates)
    for steps in (1, 100):
        time = np.linspace(0.0, end, steps + 1)
        assert run_terms(terms, time, end / steps)[-1] == pytest.approx(expected, rel=1e-9)


def test_recursion_converges_to_the_response_with_second_order():
    terms, frequency = journal(), 1e3
    omega = 2.0 * np.pi * frequency
    response = terms.response(np.array([frequency]))[0] - 1.0 - 1j * omega * terms.rest
    errors = []
    for steps in (200, 400):
        time = np.arange(steps + 1) / (steps * frequency)
        flux = np.sin(2.0 * np.pi * frequency * time)
        decay = np.exp(-np.outer(time, terms.rates))
        free = decay @ (terms.weights * omega * terms.rates / (omega**2 + terms.rates**2))
        expected = np.imag(response * np.exp(1j * omega * time)) - free
        errors.append(np.abs(run_terms(terms, flux, time[1]) - expected).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(("share", "stable"), [(0.98, True), (1.05, False)])
def test_adams_bashforth_is_stable_up_to_one_step_per_time_constant_of_journal_and_terms(share, stable):
    terms = journal()
    step = share * terms.rest / (1.0 + terms.weights.sum())
    keep, gain = terms.update(step)
    flux, memory, before = 1.0, np.zeros(len(terms.rates)), 1.0
    for _ in range(2000):
        drop = flux + memory.sum()
        change = -step / terms.rest * (1.5 * drop - 0.5 * before)
        flux, before = flux + change, drop
        memory = keep * memory + gain * change
    assert (abs(flux) < 1.0) == stable


def response_of_network(plant: Plant, frequency: float) -> complex:
    """Force along x per control current from the matrices of the network, solved at one frequency (N/A)."""
    parameters, network = plant.parameters, plant.network
    reluctance = network.reluctance(0.0, 0.0, parameters.magnetic_circuit.air_gap)
    impedance = reluctance + 2j * np.pi * frequency * network.eddy_coefficient
    if parameters.iron.solid_journal:
        terms = solid_journal_terms(parameters)
        in_journal = diffusion(np.array([frequency]), terms.time_constant)[0] - 1.0
        impedance += (in_journal - 2j * np.pi * frequency * terms.rest) * network.journal_reluctance
    constraints = flux_constraints(parameters.magnetic_circuit.coupling)
    circuits = constraints.shape[1]
    system = np.block([[impedance, constraints], [constraints.T, np.zeros((circuits, circuits))]])
    drive = np.concatenate([network.winding @ COIL_AXES[:, 0], np.zeros(circuits)])
    flux = np.linalg.solve(system, drive)[:POLES]
    bias = plant.static_flux(np.full(COILS, parameters.amplifier.bias_current), 0.0, 0.0)
    return complex((bias * flux / (mu_0 * network.pole_area)) @ np.cos(POLE_ANGLES))


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("coupling", [True, False])
@pytest.mark.parametrize("frequency", [0.0, 1e3, 30e3])
def test_force_response_is_that_of_the_network(coupling, solid, frequency):
    parameters = PlantParameters(
        magnetic_circuit=MagneticCircuitParameters(coupling=coupling, lamination_thickness=1e-3),
        iron=IronParameters(solid_journal=solid),
    )
    expected = response_of_network(Plant(parameters), frequency)
    assert force_response(parameters, np.array([frequency]))[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("coupling", [True, False])
def test_force_response_at_rest_with_ideal_iron_is_the_current_gain(coupling):
    circuit = MagneticCircuitParameters(coupling=coupling, relative_permeability=1e12)
    parameters = PlantParameters(magnetic_circuit=circuit)
    expected = current_gain(circuit, parameters.amplifier.bias_current)
    assert force_response(parameters, np.array([0.0]))[0] == pytest.approx(expected, rel=1e-9)


def test_bandwidth_of_separate_laminated_circuits_is_that_of_one_time_constant():
    circuit = MagneticCircuitParameters(coupling=False)
    parameters = PlantParameters(magnetic_circuit=circuit)
    network = Plant(parameters).network
    pair = np.zeros(POLES)
    pair[[7, 0]] = 1.0, -1.0
    reluctance = pair @ network.reluctance(0.0, 0.0, circuit.air_gap) @ pair
    expected = reluctance / (2.0 * np.pi * (pair @ network.eddy_coefficient @ pair))
    assert eddy_bandwidth(parameters) == pytest.approx(expected, rel=1e-9)


def test_bandwidth_falls_with_the_square_of_the_lamination_thickness():
    thin, thick = (
        eddy_bandwidth(PlantParameters(magnetic_circuit=MagneticCircuitParameters(lamination_thickness=thickness)))
        for thickness in (0.35e-3, 0.7e-3)
    )
    assert thin / thick == pytest.approx(4.0, rel=1e-9)
    assert thin == pytest.approx(59.1e3, rel=1e-3)


def test_solid_journal_lowers_the_bandwidth_to_some_hundred_hertz():
    solid = eddy_bandwidth(PlantParameters(iron=IronParameters(solid_journal=True)))
    assert solid == pytest.approx(432.0, rel=1e-3)


def test_without_eddy_currents_the_bandwidth_is_infinite():
    assert eddy_bandwidth(PlantParameters(iron=IronParameters(eddy_currents=False))) == np.inf


def test_closed_form_is_refused_where_it_does_not_hold():
    parameters = PlantParameters(magnetic_circuit=MagneticCircuitParameters(actuators="differential"))
    with pytest.raises(PlantError, match=r"actuators = 'differential'.*allowed: two_axis, or coupling: false"):
        force_response(parameters, np.array([0.0]))


def test_bias_current_scales_the_force_and_not_the_bandwidth():
    low, high = (PlantParameters(amplifier=AmplifierParameters(bias_current=current)) for current in (1.0, 2.0))
    at_rest = np.array([0.0])
    assert force_response(high, at_rest)[0] == pytest.approx(2.0 * force_response(low, at_rest)[0], rel=1e-12)
    assert eddy_bandwidth(high) == pytest.approx(eddy_bandwidth(low), rel=1e-9)
