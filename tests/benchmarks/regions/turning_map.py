"""The region map of a rotor that turns, beside that at rest: boundaries B and D of the paper's bearing.

The rotor runs at 100 Hz with an unbalance of 18.75 g mm, which alone moves it by some micrometres.
"""

from __future__ import annotations

import numpy as np

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import MapSettings
from amb_core.regions.region_map.sweep_run import SweepTask, run_sweep
from tests.benchmarks.regions.spread import spread

AMPLITUDES = (8e-6, 12e-6, 18e-6, 27e-6, 40e-6)  # m
TURNING = {"rotor": {"running_speed": 100.0, "unbalance": 18.75e-6}}  # Hz, kg m
SWEEP_END = 2600.0  # Hz


def measure(amplitudes: int = len(AMPLITUDES), sweep_end: float = SWEEP_END) -> dict[str, object]:
    """Largest relative differences of the boundaries, in percent, and how often B or C is found turning or not."""
    cases = [(amplitude, turning, sweep_end) for turning in (False, True) for amplitude in AMPLITUDES[:amplitudes]]
    begun = spread(boundaries, cases)
    rest, turning = begun[:amplitudes], begun[amplitudes:]
    return {
        "sweeps": len(cases),
        "b_percent": _difference(rest, turning, Region.B),
        "d_percent": _difference(rest, turning, Region.D),
        "c_at_rest": sum(Region.C in one for one in rest),
        "c_turning": sum(Region.C in one for one in turning),
    }


def boundaries(case: tuple[float, bool, float]) -> dict[Region, float]:
    """Frequencies (Hz) at which the regions of a sweep begin."""
    amplitude, turning, sweep_end = case
    settings = MapSettings(frequency_end=sweep_end, duration=sweep_end / 250.0)
    plant = validate(PlantParameters, TURNING if turning else {})
    task = SweepTask(settings.sweep(amplitude), settings.rest, plant, ControllerParameters(), RegionParameters())
    sweep = run_sweep(task)
    return {region: boundary.frequency for region, boundary in sweep.boundaries.items()}


def _difference(rest: list[dict[Region, float]], turning: list[dict[Region, float]], region: Region) -> float:
    if any((region in one) != (region in other) for one, other in zip(rest, turning, strict=True)):
        return float("inf")
    ratios = [other[region] / one[region] for one, other in zip(rest, turning, strict=True) if region in one]
    return round(100.0 * float(np.max(np.abs(np.array(ratios) - 1.0), initial=0.0)), 2)
