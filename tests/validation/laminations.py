"""Diffusion into laminations: its terms and the running plant against the closed form up to 1 MHz, and its loss.

The rotor is all but fixed, the coils have no resistance and all see the same square wave, whose harmonics decide the
currents. Flux linkage over coil current at a harmonic is N_p^2 times 2 over the drop along a pole, its gap and half of
a back-iron and a journal segment on either side per flux, where u coth(u) multiplies the reluctance of the iron:
Lammeraner, Stafl, "Eddy Currents", Iliffe 1966; Bertotti, "Hysteresis in Magnetism", Academic Press 1998, ch. 12.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
)
from amb_core.plant.eddy import diffusion, lamination_terms, lamination_time_constant
from amb_core.plant.parameters import IronParameters
from amb_core.plant.switching_loss import switching_loss
from tests.validation.energy import EnergyAccount
from tests.validation.row import Row

LIMIT = 0.01
DIFFUSION = IronParameters(laminations="diffusion")
POINTS = ((1e3, 500), (10e3, 200), (100e3, 50), (300e3, 50), (1e6, 50))
"""Frequencies (Hz) and internal steps per period."""


def rows() -> Iterator[Row]:
    """Errors of the terms, and deviations of running plants from the closed forms."""
    error = np.abs(lamination_terms(PlantParameters()).error(np.geomspace(1.0, 1e6, 5000))).max()
    yield Row("laminations, terms up to 1 MHz: drop relative to u coth(u)", error, LIMIT, "-")
    for frequency, steps in (*POINTS, (100e3, 20)):
        name = f"laminations, running plant at {1e-3 * frequency:g} kHz in steps of {1e6 / frequency / steps:.3g} us"
        deviation = impedance_error(PlantParameters(iron=DIFFUSION), frequency, steps)
        yield Row(f"{name}: flux per current relative to closed form", deviation, LIMIT, "-")
    for name, iron in (("thin", IronParameters()), ("diffusion", DIFFUSION)):
        expected, loss = switching_losses(PlantParameters(iron=iron))
        check = f"laminations, {name}: loss by switching relative to {expected:.1f} W"
        yield Row(check, abs(loss / expected - 1.0), LIMIT, "-")


def impedance_error(parameters: PlantParameters, frequency: float, steps_per_period: int) -> float:
    """Relative deviation of flux linkage per coil current from the closed form at a frequency (Hz).

    Parameters
    ----------
    parameters : PlantParameters
        Geometry and iron with shared flux.
    frequency : float
        Of the square wave (Hz).
    steps_per_period : int
        Internal steps.
    """
    rate = min(frequency, 1e4)
    held = parameters.model_copy(
        update={
            "magnetic_circuit": MagneticCircuitParameters(
                **(parameters.magnetic_circuit.model_dump() | {"coil_resistance": 0.0})
            ),
            "amplifier": AmplifierParameters(
                switching_frequency=frequency, proportional_gain=0.0, integral_gain=0.0, unipolar=False
            ),
            "rotor": RotorParameters(mass=1e5, gravity=0.0),
            "integration": IntegrationParameters(sample_rate=rate, internal_step=1.0 / (frequency * steps_per_period)),
        }
    )
    plant, tau = Plant(held), lamination_time_constant(held)
    for _ in range(int(np.ceil((1e-4 + 1.2 * tau) * rate))):  # twelve times the slowest term, tau / pi^2
        plant.advance((0.0, 0.0))
    trace, network = plant.trace((0.0, 0.0)), plant.network
    current = trace.current[-steps_per_period - 1 : -1, 0]
    linked = (0.5 * (trace.flux[1:] + trace.flux[:-1])[-steps_per_period:]) @ network.winding[:, 0]
    pattern = np.sign(network.winding.sum(axis=1))
    iron = pattern @ network.iron_reluctance @ pattern / len(pattern)
    gap = held.magnetic_circuit.air_gap * network.gap_reluctance
    drop = gap + iron * diffusion(np.array([frequency]), tau)[0]
    expected = 2.0 * held.magnetic_circuit.turns_per_pole**2 / drop
    return float(abs(np.fft.fft(linked)[1] / np.fft.fft(current)[1] / expected - 1.0))


def switching_losses(parameters: PlantParameters, samples: int = 200) -> tuple[float, float]:
    """Loss by the switching (W): closed form, and eddy currents of a levitated bearing at rest."""
    plant, controller = Plant(parameters), PdController(ControllerParameters())
    for _ in range(samples):
        plant.advance(controller.update(plant.position, (0.0, 0.0)))
    account = EnergyAccount(plant)
    for _ in range(samples):
        account.add(plant.trace(controller.update(plant.position, (0.0, 0.0))))
    return switching_loss(parameters), (account.eddy + account.diffusion) / (samples * plant.sample_time)
