"""A region map: 24 amplitudes, sweeps of 20 s, full plant with linear iron, two processes, empty cache.

The efficiency compares one process with two on this map; all times include the start of the cluster.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import amb_core.ground.tasks.pool  # noqa: F401 - the clusters' library is loaded before the clock starts
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.region_map import MapSettings, build_map

SWEEPS, DURATION = 24, 20.0  # s


def measure(sweeps: int = SWEEPS, duration: float = DURATION) -> dict[str, float | bool]:
    """Wall-clock time of the map (s), and time with one process over twice that with two."""
    two, one = (_duration(workers, sweeps, duration) for workers in (2, 1))
    return {"seconds": two, "efficiency": one / (2.0 * two)}


def _duration(workers: int, sweeps: int, duration: float) -> float:
    settings = MapSettings(initial_sweeps=sweeps, max_sweeps=sweeps, duration=duration)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        build_map(settings, PlantParameters(), ControllerParameters(), cache=Path(folder), workers=workers)
        return time.perf_counter() - started


if __name__ == "__main__":
    print(measure())
