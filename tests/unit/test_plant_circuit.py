"""The magnetic circuit against closed forms, in the limit of ideal iron."""

import numpy as np
import pytest
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant import MagneticCircuitParameters, Plant, PlantParameters
from amb_core.plant.closed_forms import current_gain, force_constant, inductance, negative_stiffness
from amb_core.plant.network import build_network, flux_constraints

IDEAL_IRON = 1e12
TURNS, AIR_GAP, BIAS = 50, 0.6e-3, 3.0
AREA = 13.89e-3 * 49.15e-3


def ideal_plant(**circuit: object) -> Plant:
    return Plant(
        PlantParameters(magnetic_circuit=MagneticCircuitParameters(relative_permeability=IDEAL_IRON, **circuit))
    )


def static_force(plant: Plant, coil_currents: list[float], x: float = 0.0, y: float = 0.0) -> np.ndarray:
    return plant.magnetostatics.force(plant.static_flux(np.array(coil_currents), x, y))


def stiffness(plant: Plant, step: float = 1e-9) -> float:
    ahead, behind = (static_force(plant, [BIAS] * 4, x=side * step)[0] for side in (1, -1))
    return (ahead - behind) / (2 * step)


@pytest.mark.parametrize("coupling", [True, False])
def test_force_of_one_electromagnet_is_the_textbook_force(coupling):
    plant = ideal_plant(coupling=coupling)
    current = 2.0
    expected = force_constant(plant.parameters.magnetic_circuit) * current**2 / AIR_GAP**2
    force = static_force(plant, [current, 0.0, 0.0, 0.0])
    assert force[0] == pytest.approx(expected, rel=1e-9)
    assert force[1] == pytest.approx(0.0, abs=1e-9 * expected)


@pytest.mark.parametrize("coupling", [True, False])
def test_current_gain_is_66_newton_per_ampere(coupling):
    plant = ideal_plant(coupling=coupling)
    current = 0.5  # the differential force is linear in it, so any value serves
    force = static_force(plant, [BIAS + current, BIAS, BIAS - current, BIAS])[0]
    expected = current_gain(plant.parameters.magnetic_circuit, BIAS)
    assert force / current == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(66.0, abs=0.1)


@pytest.mark.parametrize(("coupling", "value"), [(True, 3.57e5), (False, 3.05e5)])
def test_negative_stiffness_follows_from_the_gaps_of_all_poles_when_they_share_flux(coupling, value):
    plant = ideal_plant(coupling=coupling)
    expected = negative_stiffness(plant.parameters.magnetic_circuit, BIAS)
    assert stiffness(plant) == pytest.approx(expected, rel=1e-6)
    assert expected == pytest.approx(value, rel=2e-3)


def test_textbook_stiffness_lies_between_coupled_and_separate_circuits():
    # k_i i_0 / g takes the gap change as x instead of x cos(theta): 3.30e5 N/m.
    textbook = current_gain(MagneticCircuitParameters(), BIAS) * BIAS / AIR_GAP
    assert stiffness(ideal_plant(coupling=False)) < textbook < stiffness(ideal_plant(coupling=True))
    assert textbook == pytest.approx(3.30e5, rel=2e-3)


def test_coil_inductance_is_that_of_two_gaps_in_series():
    plant = ideal_plant(coupling=False)
    flux = plant.static_flux(np.array([1.0, 0.0, 0.0, 0.0]), 0.0, 0.0)
    linkage = (plant.network.winding.T @ flux)[0]
    expected = inductance(plant.parameters.magnetic_circuit)
    assert linkage == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(7.15e-3, rel=1e-3)


def test_bias_flux_density_is_0_314_tesla():
    flux = ideal_plant().static_flux(np.full(4, BIAS), 0.0, 0.0)
    np.testing.assert_allclose(np.abs(flux) / AREA, mu_0 * TURNS * BIAS / AIR_GAP, rtol=1e-9)
    assert abs(flux[0]) / AREA == pytest.approx(0.314, abs=1e-3)


def test_linear_iron_lowers_the_bias_flux_by_its_share_of_the_reluctance():
    real = np.abs(Plant().static_flux(np.full(4, BIAS), 0.0, 0.0)).mean()
    ideal = np.abs(ideal_plant().static_flux(np.full(4, BIAS), 0.0, 0.0)).mean()
    # poles 24.4 mm / 4000 and ring segments against a gap of 0.6 mm
    assert 0.95 < real / ideal < 0.99


@pytest.mark.parametrize("coupling", [True, False])
def test_solution_satisfies_the_network_equations(coupling):
    parameters = MagneticCircuitParameters(coupling=coupling)
    network = build_network(PlantParameters(magnetic_circuit=parameters))
    rng = np.random.default_rng(1)
    drops, voltages = rng.normal(size=8), rng.normal(size=4)
    rates, currents = np.split(network.solution @ np.concatenate([drops, voltages]), [8])
    constraints = flux_constraints(coupling)
    assert constraints.T @ rates == pytest.approx(0.0, abs=1e-9 * np.abs(rates).max())
    np.testing.assert_allclose(network.winding.T @ rates + parameters.coil_resistance * currents, voltages, atol=1e-9)
    unbalanced = network.eddy_coefficient @ rates - network.winding @ currents + drops
    potential = constraints @ np.linalg.lstsq(constraints, unbalanced, rcond=None)[0]
    np.testing.assert_allclose(unbalanced, potential, atol=1e-9 * np.abs(drops).max())


def test_ring_drops_take_energy_from_the_poles_only():
    network = build_network(PlantParameters())
    np.testing.assert_allclose(network.iron_reluctance, network.iron_reluctance.T)
    assert np.linalg.eigvalsh(network.iron_reluctance).min() > 0


@pytest.mark.parametrize(("current", "x"), [(np.nan, 0.0), (3.0, np.nan), (3.0, 0.6e-3), (np.inf, 0.0)])
def test_fluxes_are_those_of_finite_currents_around_a_rotor_within_the_gap(current, x):
    with pytest.raises(PlantError, match=r"are not finite|is not inside the air gap; allowed: less than 0.0006 m"):
        Plant().static_flux(np.full(4, current), x, 0.0)
