"""The plant alone, one call per sample: coupling, eddy currents and switching, 0.5 us internal step, one core."""

from __future__ import annotations

import statistics
import time

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import IronParameters, Plant, PlantParameters, RotorParameters

SAMPLES = 10_000
WARM_UP = 200

# Suffixes of ns_per_step, and what differs from the paper's plant: linear iron, laminations taken as thin, a point mass
# in one bearing.
VARIANTS = {
    "": PlantParameters(),
    "_iron": PlantParameters(iron=IronParameters(saturation=True, hysteresis=True)),
    "_diffusion": PlantParameters(iron=IronParameters(laminations="diffusion")),
    "_solid_journal": PlantParameters(iron=IronParameters(solid_journal=True)),
    "_rigid": PlantParameters(rotor=RotorParameters(model="rigid")),  # in two bearings
}


def measure(samples: int = SAMPLES) -> dict[str, float | bool]:
    """Median time of an internal step in a levitated bearing (ns), and simulated time over wall-clock time."""
    results: dict[str, float | bool] = {}
    for suffix, parameters in VARIANTS.items():
        sample = _sample_duration(parameters, samples)
        results[f"ns_per_step{suffix}"] = sample / parameters.steps_per_sample * 1e9
        if not suffix:
            results["realtime_factor"] = 1.0 / (parameters.integration.sample_rate * sample)
    return results


def _sample_duration(parameters: PlantParameters, samples: int) -> float:
    plant = Plant(parameters)
    controller = PdController(ControllerParameters(), len(plant.machine.axes))
    durations = []
    for _ in range(samples):
        current = controller.update(plant.position, controller.nominal_reference)
        started = time.perf_counter()
        plant.advance(current)
        durations.append(time.perf_counter() - started)
    return statistics.median(durations[min(WARM_UP, samples // 2) :])


if __name__ == "__main__":
    print(measure())
