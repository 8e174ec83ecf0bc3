"""Magnetic circuit of the thrust bearing: statics, reluctance of half order, its approximation by decaying terms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import mu_0
from scipy.integrate import quad

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.plant import PlantParameters
from amb_core.plant.thrust_bearing import half_order, half_order_terms, thrust_circuit
from amb_core.plant.thrust_parameters import ThrustBearingParameters

DEFAULT = ThrustBearingParameters()
CIRCUIT = thrust_circuit(DEFAULT)
BAND = np.geomspace(1.0, 20e3, 500)  # Hz


def phase(response: np.ndarray) -> np.ndarray:
    return np.degrees(np.angle(response))


def test_force_without_iron_is_that_of_the_textbook():
    """F = mu_0 N^2 A i^2 / (4 g^2) for two poles of the area A, Schweitzer and Maslen 2009, eq. (3.5)."""
    equal = ThrustBearingParameters(
        relative_permeability=1e6,
        slot_depth=1e-4,
        outer_radius=float(np.sqrt(0.046**2 + 0.032**2 - 0.022**2)),
    )
    area = np.pi * (0.032**2 - 0.022**2)
    one = thrust_circuit(equal).force(np.array([3.0, 0.0]), 0.0)
    assert one == pytest.approx(mu_0 * 100**2 * area * 3.0**2 / (4.0 * 0.5e-3**2), rel=1e-3)


def test_gain_and_stiffness_are_slopes_of_the_static_force():
    step = 1e-4
    by_current = [CIRCUIT.force(np.array([3.0 + s, 3.0 - s]), 0.0) for s in (-step, step)]
    assert CIRCUIT.current_gain(3.0) == pytest.approx((by_current[1] - by_current[0]) / (2.0 * step), rel=1e-6)
    by_place = [CIRCUIT.force(np.array([3.0, 3.0]), s) for s in (-1e-8, 1e-8)]
    assert CIRCUIT.negative_stiffness(3.0) == pytest.approx((by_place[1] - by_place[0]) / 2e-8, rel=1e-6)


def test_the_disc_is_pulled_towards_the_nearer_magnet():
    assert CIRCUIT.force(np.array([3.0, 3.0]), 0.0) == 0.0
    assert CIRCUIT.force(np.array([3.0, 3.0]), 100e-6) > 0.0
    assert CIRCUIT.force(np.array([4.0, 2.0]), 0.0) > 0.0


def test_the_skin_s_reluctance_is_length_over_width_of_the_path_around_the_coil():
    """c = sqrt(sigma / mu) sum of l / w; at the pole faces weighted with the square of the share of the flux."""
    r_1, r_2, r_3, r_4, depth = 0.022, 0.032, 0.046, 0.0515, 0.025
    inner = quad(lambda r: ((r**2 - r_1**2) / (r_2**2 - r_1**2)) ** 2 / r, r_1, r_2)[0]
    outer = quad(lambda r: ((r_4**2 - r**2) / (r_4**2 - r_3**2)) ** 2 / r, r_3, r_4)[0]
    path = depth / r_2 + depth / r_3 + 2.0 * np.log(r_3 / r_2) + 2.0 * inner + 2.0 * outer
    slope = np.sqrt(5e6 / (1000.0 * mu_0)) * path / (2.0 * np.pi)
    assert CIRCUIT.centred_reluctance * np.sqrt(CIRCUIT.lag) == pytest.approx(slope, rel=1e-9)


def test_the_force_falls_by_ten_decibels_a_decade_and_lags_by_45_degrees_in_the_limit():
    response = CIRCUIT.force_response(3.0, np.array([1e8, 1e9]))
    assert 20.0 * np.log10(abs(response[1] / response[0])) == pytest.approx(-10.0, abs=0.01)
    assert phase(response) == pytest.approx([-45.0, -45.0], abs=0.1)
    assert abs(CIRCUIT.force_response(3.0, np.array([0.0])))[0] == CIRCUIT.current_gain(3.0)


@pytest.mark.parametrize("change", [{}, {"conductivity": 1e6}, {"relative_permeability": 100.0}, {"air_gap": 2e-3}])
def test_the_terms_are_the_closed_form_from_1_hz_to_20_khz(change):
    circuit = thrust_circuit(ThrustBearingParameters(**change))
    error = half_order_terms(circuit.lag).response(BAND) / half_order(BAND, circuit.lag)
    assert np.abs(np.abs(error) - 1.0).max() < 0.006
    assert np.abs(phase(error)).max() < 0.35


def test_the_terms_are_passive_and_few():
    terms = half_order_terms(CIRCUIT.lag)
    assert (terms.weights > 0.0).all()
    assert (terms.rates > 0.0).all()
    assert terms.rest > 0.0
    assert len(terms.rates) <= 16


def test_laminated_steel_has_no_lag():
    circuit = thrust_circuit(ThrustBearingParameters(eddy_currents=False))
    assert circuit.lag == 0.0
    np.testing.assert_array_equal(half_order_terms(0.0).response(BAND), 1.0)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"thrust_bearing.slot_inner_radius": 0.05}, "slot_inner_radius = 0.05 m must be smaller than"),
        ({"thrust_bearing.clearance": 6e-4}, "clearance = 0.0006 m must be smaller than air_gap"),
        ({"thrust_bearing.bias_current": 11.0}, "bias_current = 11 A must not exceed current_limit = 10 A"),
        ({"rotor.axial": True, "rotor.initial_z": 3e-4}, "rotor.initial_z = 0.0003 m must lie inside the axial backup"),
        ({"rotor.initial_z": 1e-5}, "rotor.initial_z is given and rotor.axial is off"),
        ({"rotor.external_force_z": 1.0}, "rotor.external_force_z is given and rotor.axial is off"),
        ({"rotor.axial": True, "magnetic_circuit.actuators": "top_coil"}, "allowed with a thrust bearing: two_axis"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(values, reason):
    with pytest.raises(ParameterError, match=reason) as refused:
        validate(PlantParameters, values)
    assert "\n" not in str(refused.value)
