"""Diffusion into laminations against its closed form up to 1 MHz: terms, running plant, force bandwidth, loss.

Laminations drawn at random are those of the paper's bearing but for thickness, permeability and conductivity.
"""

from __future__ import annotations

import numpy as np

from amb_core.plant import MagneticCircuitParameters, PlantParameters
from amb_core.plant.eddy import lamination_terms
from amb_core.plant.parameters import IronParameters
from tests.benchmarks.regions.spread import spread
from tests.validation.laminations import DIFFUSION, POINTS, impedance_error, switching_losses

SEED = 13
TERMS, PLANTS = 200, 6
LOWEST, HIGHEST = (0.05e-3, 300.0, 1e6), (1e-3, 2e4, 1e7)  # thickness (m), relative permeability, conductivity (S/m)


def measure(terms: int = TERMS, plants: int = PLANTS) -> dict[str, object]:
    """Largest error of all comparisons (%), and the largest of each kind."""
    rng = np.random.default_rng(SEED)
    drawn = [_circuit(*case) for case in np.exp(rng.uniform(np.log(LOWEST), np.log(HIGHEST), (terms, 3)))]
    frequency = np.geomspace(1.0, 1e6, 2000)
    worst = max(
        np.abs(lamination_terms(PlantParameters(magnetic_circuit=circuit)).error(frequency)).max() for circuit in drawn
    )
    circuits = [PlantParameters(magnetic_circuit=circuit, iron=DIFFUSION) for circuit in drawn[:plants]]
    running = max(spread(_impedance_errors, [PlantParameters(iron=DIFFUSION), *circuits]))
    losses = [switching_losses(PlantParameters(iron=iron)) for iron in (IronParameters(), DIFFUSION)]
    loss = max(abs(measured / expected - 1.0) for expected, measured in losses)
    percent = {
        f"{name}_percent": round(100.0 * float(error), 3)
        for name, error in (("terms", worst), ("running_plant", running), ("switching_loss", loss))
    }
    watts = {"thin_w": round(losses[0][1], 2), "diffusion_w": round(losses[1][1], 2)}
    return {
        "error_percent": max(percent.values()),
        **percent,
        **watts,
        "laminations": terms,
        "plants": 1 + plants,
        "seed": SEED,
    }


def _circuit(thickness: float, permeability: float, conductivity: float) -> MagneticCircuitParameters:
    return MagneticCircuitParameters(
        lamination_thickness=thickness, relative_permeability=permeability, iron_conductivity=conductivity
    )


def _impedance_errors(parameters: PlantParameters) -> float:
    return max(impedance_error(parameters, frequency, steps) for frequency, steps in POINTS)
