"""Where the regions of the paper's bearing begin in the sweep of its Fig. 5, and what changes that.

Each variant changes one thing of the loop. A region of a variant begins at one frequency for each amplitude, or None
where the sweep has no such region.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import MapSettings
from amb_core.regions.region_map.sweep_run import SweepTask, run_sweep
from tests.benchmarks.regions.spread import spread

AMPLITUDES = (10e-6, 15e-6, 20e-6, 25e-6, 30e-6, 35e-6, 50e-6, 70e-6, 100e-6)  # m
SWEEP_END = 5_000.0  # Hz
SWEEP_RATE = 249.5  # Hz/s


@dataclass(frozen=True)
class Variant:
    """What differs from the paper's bearing and its controller."""

    plant: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)


TOP_COIL = {"magnetic_circuit": {"actuators": "top_coil"}}
VARIANTS = {
    "paper": Variant(),
    "limit_10_a": Variant(controller={"current_limit": 10.0}),
    "no_gravity": Variant({"rotor": {"gravity": 0.0}}),
    "on_measurement": Variant(controller={"derivative_on": "measurement"}),
    "top_coil": Variant(TOP_COIL),
    "top_coil_10_a": Variant(TOP_COIL, {"current_limit": 10.0}),
}


def measure(amplitudes: int = len(AMPLITUDES), sweep_end: float = SWEEP_END) -> dict[str, object]:
    """Amplitudes (um), and by variant where B, C and D begin (Hz)."""
    chosen = AMPLITUDES[:amplitudes]
    cases = [(name, amplitude, sweep_end) for name in VARIANTS for amplitude in chosen]
    begun = dict(zip(cases, spread(onsets, cases), strict=True))
    return {
        "amplitudes": [round(1e6 * amplitude) for amplitude in chosen],
        **{
            name: {
                region.name.lower(): [begun[name, amplitude, sweep_end].get(region) for amplitude in chosen]
                for region in (Region.B, Region.C, Region.D)
            }
            for name in VARIANTS
        },
    }


def onsets(case: tuple[str, float, float]) -> dict[Region, float]:
    """Frequencies (Hz) at which the regions of a sweep begin."""
    name, amplitude, sweep_end = case
    variant = VARIANTS[name]
    settings = MapSettings(frequency_end=sweep_end, duration=(sweep_end - 10.0) / SWEEP_RATE)
    plant = validate(PlantParameters, variant.plant)
    controller = validate(ControllerParameters, variant.controller)
    task = SweepTask(settings.sweep(amplitude), settings.rest, plant, controller, RegionParameters())
    return {region: boundary.frequency for region, boundary in run_sweep(task).boundaries.items()}
