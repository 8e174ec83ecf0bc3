"""The running plant: energy balance, order of the integrator, and the paper's eq. (3) along a trajectory."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.integrate import trapezoid

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
)
from amb_core.plant.closed_forms import AXIS_COSINE, force_constant
from amb_core.plant.network import COIL_POLES, POLES
from amb_core.plant.parameters import BackupBearingParameters, ConverterParameters, IronParameters, SensorParameters
from tests.validation.energy import EnergyAccount
from tests.validation.row import Row

PERIODS = 40  # until the loops of the iron, which run into one another, repeat
DIFFUSION = PlantParameters(iron=IronParameters(laminations="diffusion"))
INTERNAL_STEPS = (1e-6, 0.5e-6, 0.25e-6, 0.125e-6)
EVERYTHING = PlantParameters(
    iron=IronParameters(saturation=True, hysteresis=True, solid_journal=True),
    # A voltage drives so much current through a solid journal at once that the usual gain would oscillate.
    amplifier=AmplifierParameters(carriers="interleaved", dead_time=0.3e-6, proportional_gain=0.4),
    rotor=RotorParameters(
        model="rigid",
        running_speed=120.0,
        unbalance=2e-4,
        external_force_x=30.0,
        external_force_frequency=150.0,
        backup_bearing_radius=60e-6,
    ),
    backup_bearing=BackupBearingParameters(contact=True),
    sensor=SensorParameters(bandwidth=8e3, noise=50e-9),
    converters=ConverterParameters(position_resolution=50e-9, current_resolution=1e-3, computation_delay=0.4),
)


def energy(samples: int = 10_000) -> Iterator[Row]:
    """Energy balances of magnetic circuit and rotor over 1 s of 50 um square waves of 5 Hz on both axes."""
    for name, parameters in (("paper", PlantParameters()), ("diffusion", DIFFUSION), ("everything on", EVERYTHING)):
        plant = Plant(parameters)
        axes = len(plant.machine.axes)
        account, controller = EnergyAccount(plant), PdController(ControllerParameters(), axes)
        for sample in range(samples):
            reference = np.zeros(axes)
            reference[:2] = 50e-6 if sample % 2_000 < 1_000 else -50e-6
            account.add(plant.trace(controller.update(plant.position, reference)))
        if parameters.backup_bearing.contact and account.contact == 0.0:
            raise RuntimeError("the rotor was to touch its backup bearing")
        yield Row(
            f"energy balance over 1 s, {name}: of the circuit, over the electrical energy",
            abs(account.circuit_residual) / account.electrical,
            1e-4,
            "-",
        )
        yield Row(
            f"energy balance over 1 s, {name}: of the rotor, over the work to and fro",
            abs(account.rotor_residual) / account.work,
            1e-4,
            "-",
        )


def iron_loss() -> Iterator[Row]:
    """Areas of the loops of field over flux density of all iron elements against the energy that the plant reports.

    The loops of a cosine of 100 Hz on x and of 50 Hz on y, with averaged voltages, are drawn through one point every
    10 us; the plant adds up its energy every 0.5 us.
    """
    parameters = PlantParameters(
        iron=IronParameters(saturation=True, hysteresis=True),
        amplifier=AmplifierParameters(switching=False),
        rotor=RotorParameters(mass=1e5, gravity=0.0),
        integration=IntegrationParameters(sample_rate=100e3),
    )
    plant, period = Plant(parameters), 2_000
    loops, energies = np.empty((period + 1, 2, 3 * POLES)), np.empty(period + 1)
    for sample in range(-(PERIODS - 1) * period, period + 1):
        turn = 2.0 * np.pi * sample / period
        trace = plant.trace((2.0 * np.cos(2.0 * turn), 2.0 * np.cos(turn)))
        if sample >= 0:
            bearing = plant._arrays.bearings[0]
            loops[sample] = bearing["iron"]["flux_density"], bearing["iron"]["field"]
            energies[sample] = trace.iron_energy[-1] - bearing["ring"]["loss"]
    flux_density, field = loops[:, 0], loops[:, 1]
    volumes = np.repeat([length * area for length, area in plant.network.paths], POLES)
    areas = trapezoid(field, flux_density, axis=0)
    loss = energies[-1] - energies[0]
    yield Row(
        "iron loss of the running plant: relative to the areas of its loops",
        abs(float(volumes @ areas) / loss - 1.0),
        1e-3,
        "-",
    )
    yield Row(
        "iron loss of the running plant: field after a period, relative to its range",
        float((np.abs(field[-1] - field[0]) / np.ptp(field, axis=0)).max()),
        1e-3,
        "-",
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
    """Fluxes and position at the start of each of 60 controller samples, the reference 10 um on x from the first."""
    integration = IntegrationParameters(internal_step=internal_step)
    plant = Plant(PlantParameters(integration=integration, amplifier=amplifier))
    controller = PdController(ControllerParameters())
    samples = np.empty((60, 10))
    for row in samples:
        trace = plant.trace(controller.update(plant.position, (10e-6, 0.0)))
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
        trace = plant.trace(controller.update(plant.position, (reference, 0.0)))
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
