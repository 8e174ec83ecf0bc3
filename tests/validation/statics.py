"""The magnetic circuit at rest against closed forms, with ideal iron."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from amb_core.plant import MagneticCircuitParameters, Plant, PlantParameters
from amb_core.plant.closed_forms import AXIS_COSINE, current_gain, force_constant, inductance, negative_stiffness
from amb_core.plant.network import COIL_AXES, COILS
from tests.validation.row import Row

IDEAL_IRON = 1e12  # relative permeability
LIMIT = 1e-9
DISPLACEMENT = 1e-6  # m


def rows() -> Iterator[Row]:
    """Relative deviations of force, k_i, k_s and inductance, and of the paper's eq. (2)."""
    for coupling, circuits in ((True, "shared flux"), (False, "separate circuits")):
        circuit = MagneticCircuitParameters(relative_permeability=IDEAL_IRON, coupling=coupling)
        plant = Plant(PlantParameters(magnetic_circuit=circuit))
        bias = plant.parameters.amplifier.bias_current
        force = _force(plant, np.array([bias, 0.0, 0.0, 0.0]))
        textbook = force_constant(circuit) * bias**2 / circuit.air_gap**2
        yield _relative(f"force of one electromagnet, {circuits}", force, textbook)
        gain = _force(plant, bias + COIL_AXES[:, 0])  # per 1 A: the force of a pair is linear in the control current
        yield _relative(f"current gain k_i, {circuits}", gain, current_gain(circuit, bias))
        yield _relative(f"negative stiffness k_s, {circuits}", _stiffness(plant), negative_stiffness(circuit, bias))
    linkage = plant.network.winding.T @ plant.static_flux(np.array([1.0, 0.0, 0.0, 0.0]), 0.0, 0.0)
    yield _relative("inductance, separate circuits", linkage[0], inductance(circuit))
    yield Row("eq. (2), force k i^2 / x_g^2 for 0.5 to 10 A, -200 to 200 um", _law_of_force(plant), LIMIT, "-")


def _relative(name: str, measured: float, expected: float) -> Row:
    return Row(f"{name}: relative to closed form", abs(measured / expected - 1.0), LIMIT, "-")


def _force(plant: Plant, coil_currents: np.ndarray, x: float = 0.0) -> float:
    """Force on the rotor along x (N)."""
    return float(plant.magnetostatics.force(plant.static_flux(coil_currents, x, 0.0))[0])


def _stiffness(plant: Plant) -> float:
    """Slope of the force over x at bias current (N/m), by Richardson's extrapolation of central differences."""
    bias = np.full(COILS, plant.parameters.amplifier.bias_current)
    wide, narrow = (
        (_force(plant, bias, step) - _force(plant, bias, -step)) / (2.0 * step)
        for step in (2.0 * DISPLACEMENT, DISPLACEMENT)
    )
    return (4.0 * narrow - wide) / 3.0


def _law_of_force(plant: Plant) -> float:
    """Largest relative deviation of the force of electromagnet +x alone from the paper's eq. (2)."""
    circuit = plant.parameters.magnetic_circuit
    worst = 0.0
    for x in np.linspace(-200e-6, 200e-6, 9):
        gap = circuit.air_gap - x * AXIS_COSINE  # the poles stand at an angle to the displacement
        for current in np.linspace(0.5, 10.0, 20):
            force = _force(plant, np.array([current, 0.0, 0.0, 0.0]), x)
            worst = max(worst, abs(force / (force_constant(circuit) * current**2 / gap**2) - 1.0))
    return worst
