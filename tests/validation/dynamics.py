"""The running plant: energy balance, order of the integrator, and the paper's eq. (3) along a trajectory."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from row import Row
from scipy.constants import mu_0

from amb_core.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
)
from amb_core.plant.closed_forms import AXIS_COSINE, force_constant
from amb_core.plant.energy import EnergyAccount
from amb_core.plant.network import COIL_POLES

INTERNAL_STEPS = (1e-6, 0.5e-6, 0.25e-6, 0.125e-6)


def energy() -> Iterator[Row]:
    """Energy balance over 1 s of 50 um square waves of 5 Hz on both axes."""
    plant, controller = Plant(), PdController(ControllerParameters())
    account = EnergyAccount(plant)
    for sample in range(10_000):
        reference = 50e-6 if sample % 2_000 < 1_000 else -50e-6
        account.add(plant.trace(*controller.update(*plant.position, reference, reference)))
    gained = account.stored + account.kinetic + account.potential
    missing = account.electrical - account.copper - account.eddy - gained
    yield Row("energy balance over 1 s, over the electrical energy", abs(missing) / account.electrical, 1e-4, "-")
    unbalanced = account.mechanical - account.kinetic - account.potential
    yield Row(
        "energy balance of the rotor over 1 s, over the work to and fro", abs(unbalanced) / account.work, 1e-4, "-"
    )


def convergence() -> Iterator[Row]:
    """Observed order over internal steps of 1, 0.5, 0.25 and 0.125 us, of fluxes at the controller samples.

    First with switching instants that lie on the grid of every step (constant duty of 0.5, period of 8 us), then in a
    levitated bearing, where they fall anywhere in a step.
    """
    on_grid = AmplifierParameters(proportional_gain=0.0, integral_gain=0.0, switching_frequency=125e3)
    for name, amplifier, limit in (
        ("switching on the grid", on_grid, 0.1),
        ("levitated", AmplifierParameters(), 0.5),
    ):
        runs = [_samples(step, amplifier) for step in INTERNAL_STEPS]
        changes = [_rms(coarse[:, :8] - fine[:, :8]) for coarse, fine in itertools.pairwise(runs)]
        order = float(np.log2(changes[0] / changes[-1])) / (len(changes) - 1)
        yield Row(f"order of the integrator, {name}: below 2 by", 2.0 - order, limit, "-")
    moved = np.abs(runs[1][:, 8:] - runs[-1][:, 8:]).max()
    yield Row("positions with internal steps of 0.5 against 0.125 us, levitated", 1e9 * float(moved), 1.0, "nm")


def _samples(internal_step: float, amplifier: AmplifierParameters) -> NDArray[np.float64]:
    """Fluxes and position at the start of each of 100 controller samples, the reference 10 um on x from the first."""
    integration = IntegrationParameters(internal_step=internal_step)
    plant = Plant(PlantParameters(integration=integration, amplifier=amplifier))
    controller = PdController(ControllerParameters())
    samples = np.empty((100, 10))
    for row in samples:
        trace = plant.trace(*controller.update(*plant.position, 10e-6, 0.0))
        row[:8], row[8:] = trace.flux[0], trace.position[0]
    return samples


def derivative_of_force() -> Iterator[Row]:
    """The paper's eq. (3) for electromagnet +x of a levitated bearing, against differences of its traced force.

    Eq. (2), whose derivative it is, holds with ideal iron, separate circuits and no eddy currents. These cannot be
    switched off, so the laminations are thin and the internal step is short accordingly; averaged voltages leave
    derivatives that finite differences can follow. The reference is a sine of 50 um and 100 Hz on x, over one period.
    """
    circuit = MagneticCircuitParameters(relative_permeability=1e12, coupling=False, lamination_thickness=0.02e-3)
    plant = Plant(
        PlantParameters(
            magnetic_circuit=circuit,
            amplifier=AmplifierParameters(switching=False),
            integration=IntegrationParameters(internal_step=4e-9),
        )
    )
    step, k = plant.parameters.integration.internal_step, force_constant(circuit)
    controller = PdController(ControllerParameters())
    difference, scale = 0.0, 0.0
    for sample in range(100):
        reference = 50e-6 * np.sin(2.0 * np.pi * 100.0 * sample * plant.sample_time)
        trace = plant.trace(*controller.update(*plant.position, reference, 0.0))
        force = np.sum(trace.flux[:, COIL_POLES[0]] ** 2, axis=1) * AXIS_COSINE / (2.0 * mu_0 * plant.network.pole_area)
        gap = circuit.air_gap - AXIS_COSINE * trace.position[:, 0]
        i, x = _middles(trace.current[:, 0]), _middles(gap)
        i_rate, x_rate = np.diff(trace.current[:, 0]) / step, np.diff(gap) / step
        expected = (2.0 * k * i * i_rate * x**2 - 2.0 * k * i**2 * x * x_rate) / x**4
        difference += float(np.sum((np.diff(force) / step - expected) ** 2))
        scale += float(np.sum(expected**2))
    yield Row(
        "eq. (3), force of electromagnet +x along a trajectory: rms difference over rms",
        float(np.sqrt(difference / scale)),
        1e-3,
        "-",
    )


def _middles(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.5 * (values[1:] + values[:-1])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
