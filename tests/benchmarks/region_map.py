"""A region map: 24 amplitudes, the paper's sweeps of 20 s, full plant with linear iron, two processes, empty cache.

The efficiency compares one process with two on twelve of these amplitudes; all times include the start of the cluster.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from amb_core.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.region_map import MapSettings, build_map

SWEEPS = 24
SWEEPS_COMPARED = 12


def measure() -> dict[str, float | bool]:
    """Wall-clock time of the map (s), and time with one process over twice that with two."""
    one, two = (_duration(SWEEPS_COMPARED, workers) for workers in (1, 2))
    return {"seconds": _duration(SWEEPS, 2), "efficiency": one / (2.0 * two)}


def _duration(sweeps: int, workers: int) -> float:
    settings = MapSettings(initial_sweeps=sweeps, max_sweeps=sweeps)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        build_map(settings, PlantParameters(), ControllerParameters(), cache=Path(folder), workers=workers)
        return time.perf_counter() - started


if __name__ == "__main__":
    print(measure())
