"""Eddy currents: the terms of a solid journal, and the force of the running plant against its closed form.

The rotor is all but fixed and the x axis is excited with a sine. What counts is the way to the force from the control
current, half the difference of the coil currents of +x and -x as they are, so the amplifiers may be slow. It is linear:
the squares of the fluxes of opposite electromagnets cancel.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.constants import mu_0

from amb_core.plant import (
    AmplifierParameters,
    IntegrationParameters,
    MagneticCircuitParameters,
    Plant,
    PlantParameters,
    RotorParameters,
)
from amb_core.plant.eddy import eddy_bandwidth, force_response, solid_journal_terms
from amb_core.plant.network import COIL_AXES, POLE_ANGLES
from amb_core.plant.parameters import IronParameters
from tests.validation.row import Row

LIMIT = 0.01
AMPLITUDE = 0.5  # A
PERIODS_TO_SETTLE, PERIODS = 4, 4


def rows() -> Iterator[Row]:
    """Errors of the terms, and deviations of bandwidth and force response from the closed forms."""
    yield from _terms()
    for name, thickness, coupling, solid in (
        ("laminations of 3 mm, shared flux", 3e-3, True, False),
        ("laminations of 3 mm, separate circuits", 3e-3, False, False),
        ("laminations of 1 mm, shared flux", 1e-3, True, False),
        ("solid journal, shared flux", 0.35e-3, True, True),
        ("solid journal, separate circuits", 0.35e-3, False, True),
    ):
        parameters = PlantParameters(
            # Without resistance the bias current needs no voltage, and stays as it is.
            magnetic_circuit=MagneticCircuitParameters(
                lamination_thickness=thickness, coupling=coupling, coil_resistance=0.0
            ),
            iron=IronParameters(solid_journal=solid),
            # Through thick laminations a voltage drives so much current at once that the usual gain would oscillate.
            amplifier=AmplifierParameters(switching=False, proportional_gain=0.02, integral_gain=0.0),
            rotor=RotorParameters(mass=1e5, gravity=0.0),
            integration=IntegrationParameters(sample_rate=1e5, internal_step=0.1e-6),
        )
        yield from _responses(name, parameters)


def _terms() -> Iterator[Row]:
    for step in (0.5e-6, 0.1e-6):
        terms = solid_journal_terms(PlantParameters(integration=IntegrationParameters(internal_step=step)))
        ratio = 1.0 + terms.error(np.geomspace(1e-4, terms.highest_frequency, 5000))
        name = f"solid journal, {len(terms.rates)} terms up to {1e-3 * terms.highest_frequency:.0f} kHz"
        yield Row(
            f"{name}: magnitude of the drop, relative to u coth(u)", np.abs(np.abs(ratio) - 1.0).max(), LIMIT, "-"
        )
        yield Row(f"{name}: phase of the drop against u coth(u)", np.abs(np.angle(ratio, deg=True)).max(), 1.0, "deg")


def _responses(name: str, parameters: PlantParameters) -> Iterator[Row]:
    bandwidth = eddy_bandwidth(parameters)
    frequencies = bandwidth * np.array([0.2, 0.97, 1.03, 2.0])
    measured = np.array([_response(parameters, frequency) for frequency in frequencies])
    deviation = np.abs(measured / force_response(parameters, frequencies) - 1.0).max()
    # Where the gain crosses -3 dB, between the two middle frequencies.
    wanted = np.log(_gain_at_rest(parameters) / np.sqrt(2.0))
    crossing = np.exp(np.interp(-wanted, -np.log(np.abs(measured[1:3])), np.log(frequencies[1:3])))
    yield Row(f"eddy bandwidth, {name}: relative to {bandwidth:.0f} Hz", abs(crossing / bandwidth - 1.0), LIMIT, "-")
    yield Row(f"force per current, 0.2 to 2 bandwidths, {name}: relative to closed form", deviation, LIMIT, "-")


def _response(parameters: PlantParameters, frequency: float) -> complex:
    """Force along x per control current of a running plant at one frequency (N/A)."""
    plant = Plant(parameters)
    samples = round((PERIODS_TO_SETTLE + PERIODS) / (frequency * plant.sample_time))
    traces = [
        plant.trace((AMPLITUDE * np.sin(2.0 * np.pi * frequency * sample * plant.sample_time), 0.0))
        for sample in range(samples)
    ]
    force = np.concatenate([trace.force[:, 0] for trace in traces])
    current = np.concatenate([trace.current @ (0.5 * COIL_AXES[:, 0]) for trace in traces])
    time = np.arange(len(force)) * parameters.integration.internal_step
    steady = time * frequency >= PERIODS_TO_SETTLE
    turn = 2.0 * np.pi * frequency * time[steady]
    basis = np.column_stack([np.cos(turn), np.sin(turn), np.ones_like(turn), turn])  # with offset and drift
    fitted = np.linalg.lstsq(basis, np.column_stack([force[steady], current[steady]]), rcond=None)[0]
    in_force, in_current = fitted[0] - 1j * fitted[1]
    return complex(in_force / in_current)


def _gain_at_rest(parameters: PlantParameters) -> float:
    """Force along x per constant control current (N/A)."""
    plant = Plant(parameters)
    flux = plant.static_flux(parameters.amplifier.bias_current + COIL_AXES[:, 0], 0.0, 0.0)
    return float(flux**2 @ np.cos(POLE_ANGLES)) / (2.0 * mu_0 * plant.network.pole_area)
