"""How many random plausible bearings `amb new` levitates: gains found, and the lift-off simulated with full physics."""

from __future__ import annotations

from typing import Any

import numpy as np

from amb_core.designs.tuning import HIGHEST_PEAK, Bearing, design_bearing, plant_of
from amb_core.ground.errors import PlantError
from amb_core.plant.closed_forms import current_gain

SEED = 20_261
BEARINGS = 100
RATES = (3e3, 5e3, 8e3, 10e3, 12.5e3, 16e3, 20e3, 25e3, 40e3)  # Hz, of common controllers
FLUX_DENSITY = 0.2, 0.6  # T at bias current, below the saturation of electrical steel at twice the bias
LOAD = 0.03, 0.3
"""Weight over the force of the centred rotor at a control current as large as the bias.

On the backup bearing, half a gap lower, 1 / 1.5^2 = 0.44 of that force are left in the ideal circuit: what weighs more
cannot rise.
"""


def random_bearing(generator: np.random.Generator) -> Bearing:
    """A bearing as somebody may have built it: turns for the flux density, a mass that it can lift."""
    gap = float(f"{np.exp(generator.uniform(np.log(0.2e-3), np.log(1e-3))):.2g}")
    bias = float(f"{generator.uniform(1.0, 6.0):.2g}")
    diameter = float(f"{generator.uniform(25e-3, 120e-3):.2g}")
    values: dict[str, Any] = {
        "gap": gap,
        "bias_current": bias,
        "turns": max(round(generator.uniform(*FLUX_DENSITY) * gap / (4e-7 * np.pi * bias)), 1),
        "journal_diameter": diameter,
        "length": float(f"{generator.uniform(0.3, 1.0) * diameter:.2g}"),
        "voltage": float(f"{np.exp(generator.uniform(np.log(12.0), np.log(400.0))):.2g}"),
        "sample_rate": float(generator.choice(RATES)),
        "delay": float(generator.choice([0.0, 0.5, 1.0])),
        "sensor_bandwidth": float(generator.choice([0.0, 10e3, 5e3])),
        "resistance": float(f"{generator.uniform(0.1, 1.0):.2g}"),
    }
    circuit = plant_of(Bearing(mass=1.0, **values)).magnetic_circuit
    force = bias * current_gain(circuit, bias)
    load = float(np.exp(generator.uniform(*np.log(LOAD))))
    return Bearing(mass=float(f"{load * force / 9.81:.3g}"), **values)


def measure(bearings: int = BEARINGS, seed: int = SEED) -> dict[str, Any]:
    """Counts of the bearings tried, of those that levitate with a peak sensitivity <= 3, and the reasons of the others.

    Parameters
    ----------
    bearings : int, optional
        How many.
    seed : int, optional
        Of the generator.

    Returns
    -------
    dict
        `bearings`, `levitated`, `explained` (refused with a reason), `reasons` and `worst_peak_sensitivity`.
    """
    generator = np.random.default_rng(seed)
    peaks, reasons = [], []
    for _ in range(bearings):
        bearing = random_bearing(generator)
        try:
            design = design_bearing(bearing)
        except PlantError as problem:
            reasons.append(f"{bearing}: {problem}")
            continue
        if design.lift_off.levitated and design.tuned.peak_sensitivity <= HIGHEST_PEAK:
            peaks.append(design.tuned.peak_sensitivity)
    return {
        "bearings": bearings,
        "levitated": len(peaks),
        "explained": len(reasons),
        "reasons": reasons,
        "worst_peak_sensitivity": max(peaks, default=0.0),
    }


if __name__ == "__main__":
    import json

    print(json.dumps(measure(), indent=2))
