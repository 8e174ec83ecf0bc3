"""The plant's kernel alone: linear iron, coupling, eddy currents and switching, 0.5 us internal step, one core."""

from __future__ import annotations

import statistics
import time

from amb_core.control import ControllerParameters, PdController
from amb_core.plant import Plant

SAMPLES = 20_000
WARM_UP = 200


def measure() -> dict[str, float | bool]:
    """Median time of an internal step in a levitated bearing (ns), and simulated time over wall-clock time."""
    plant = Plant()
    controller = PdController(ControllerParameters())
    durations = []
    for _ in range(SAMPLES):
        current = controller.update(*plant.position, 0.0, 0.0)
        started = time.perf_counter()
        plant.advance(*current)
        durations.append(time.perf_counter() - started)
    sample = statistics.median(durations[WARM_UP:])
    return {
        "ns_per_step": sample / plant.parameters.steps_per_sample * 1e9,
        "realtime_factor": plant.sample_time / sample,
    }


if __name__ == "__main__":
    print(measure())
