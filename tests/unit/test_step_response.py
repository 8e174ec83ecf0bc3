"""Natural frequency and damping ratio measured on steps."""

import numpy as np
import pytest
from scipy.signal import lti, step

from amb_core.ground.errors import IdentificationError
from amb_core.linear.step_response import fit_step_response
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters, RotorParameters
from amb_core.plant.simulation import simulate


@pytest.mark.parametrize("natural_hz", [20.0, 63.0, 200.0])
@pytest.mark.parametrize("damping", [0.1, 0.5, 0.8])
def test_poles_of_a_second_order_system_with_a_zero_are_found(natural_hz, damping):
    rate = 2 * np.pi * natural_hz
    time = np.arange(0, 0.2, 1e-4)
    _, response = step(lti([1.5 * rate, rate**2], [1, 2 * damping * rate, rate**2]), T=time)
    mode = fit_step_response(-3e-6 * response + 5e-6, 1e-4)
    assert mode.natural_hz == pytest.approx(natural_hz, rel=1e-3)
    assert mode.damping_ratio == pytest.approx(damping, rel=1e-3)


@pytest.mark.parametrize("response", [np.zeros(100), np.full(100, np.nan)])
def test_response_without_a_step_is_refused(response):
    with pytest.raises(IdentificationError, match="constant or not finite"):
        fit_step_response(response, 1e-4)


def test_paper_bearing_has_its_natural_frequency_and_damping():
    # Small step on x; the limits are those that the paper's "about 63 Hz" leaves.
    excitation = np.zeros((2_000, 2))
    excitation[:, 0] = 1e-6
    record = simulate(Plant(), PdController(ControllerParameters()), 4_000, excitation, 2_000)
    mode = fit_step_response(record.position[2_000:, 0], record.sample_time)
    assert mode.natural_hz == pytest.approx(63.0, abs=3.0)
    assert mode.damping_ratio == pytest.approx(0.51, abs=0.06)


def test_loop_without_gravity_has_the_poles_of_the_linearised_bearing():
    # k_i and k_s of the network with iron, from the static force; the rest of the difference is the lag of hold,
    # amplifier and eddy currents (about 0.07 ms): it takes K_P times the lag, 4 %, from K_D.
    plant = Plant(PlantParameters(rotor=RotorParameters(gravity=0.0)))
    stiffness, gain = _static_stiffness_and_gain(plant)
    mass, controller = plant.parameters.rotor.mass, ControllerParameters()
    rate = np.sqrt((gain * controller.proportional_gain - stiffness) / mass)
    excitation = np.zeros((1_500, 2))
    excitation[:, 0] = 0.2e-6
    record = simulate(plant, PdController(controller), 2_000, excitation, 500)
    mode = fit_step_response(record.position[500:, 0], record.sample_time)
    assert mode.natural_hz == pytest.approx(rate / (2 * np.pi), rel=0.03)
    assert mode.damping_ratio == pytest.approx(gain * controller.derivative_gain / (2 * mass * rate), rel=0.05)


def _static_stiffness_and_gain(plant: Plant) -> tuple[float, float]:
    from scipy.constants import mu_0

    from amb_core.plant.network import COIL_AXES, POLE_ANGLES

    def force(x: float, current: float) -> float:
        flux = plant.static_flux(3.0 + COIL_AXES[:, 0] * current, x, 0.0)
        return float(np.sum(flux**2 * np.cos(POLE_ANGLES)) / (2 * mu_0 * plant.network.pole_area))

    return (force(1e-9, 0.0) - force(-1e-9, 0.0)) / 2e-9, (force(0.0, 1e-6) - force(0.0, -1e-6)) / 2e-6
