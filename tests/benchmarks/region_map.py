"""A region map: 24 amplitudes, the paper's sweeps of 20 s, full plant with linear iron, two processes, empty cache.

The efficiency compares one process with two on this map; all times include the start of the cluster.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import amb_core.tasks.pool  # noqa: F401 - the clusters' library is loaded before the clock starts
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.region_map import MapSettings, build_map

SWEEPS = 24


def measure() -> dict[str, float | bool]:
    """Wall-clock time of the map (s), and time with one process over twice that with two."""
    two, one = (_duration(workers) for workers in (2, 1))
    return {"seconds": two, "efficiency": one / (2.0 * two)}


def _duration(workers: int) -> float:
    settings = MapSettings(initial_sweeps=SWEEPS, max_sweeps=SWEEPS)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        build_map(settings, PlantParameters(), ControllerParameters(), cache=Path(folder), workers=workers)
        return time.perf_counter() - started


if __name__ == "__main__":
    print(measure())
