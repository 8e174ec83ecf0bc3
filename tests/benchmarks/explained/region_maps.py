"""Where the regions of three bearings begin, by sweeps of two rates and by fixed sines; the paper's also weightless.

Sweeps are those of `amb map` on y, 10 Hz to 5 kHz in 20 s, and fixed sines those of `amb map --confirm`.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from amb_core.ground.parameters import validate
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import (
    BOUNDARIES,
    Confirmation,
    ConfirmationSettings,
    MapSettings,
    MapSweep,
    RegionMap,
    confirm_map,
)
from amb_core.regions.region_map.confirmation import Direction
from amb_core.regions.region_map.sweep_run import SweepTask, run_sweep
from tests.front_door.figures import Figures

RESONANCE = r"\*"  # Markdown's asterisk


@dataclass(frozen=True)
class Bearing:
    """What of a bearing and its controller differs from the paper's, and amplitudes (m) at which it is confirmed."""

    amplitudes: tuple[float, ...]
    plant: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)


def ratios(low: float, high: float, intervals: int, places: tuple[int, ...]) -> tuple[float, ...]:
    """Some places of a range of amplitudes that is divided into intervals of equal ratio."""
    return tuple(low * (high / low) ** (place / intervals) for place in places)


PAPER_AMPLITUDES = ratios(5e-6, 100e-6, 24, (0, 3, 6, 9, 12, 15, 18, 20, 21, 22, 24))  # m
CONFIRMED_AMPLITUDES = ratios(5e-6, 100e-6, 4, (0, 1, 2, 3, 4))  # m
BEARINGS = {
    "paper": Bearing(CONFIRMED_AMPLITUDES),
    "supply_30_v": Bearing(CONFIRMED_AMPLITUDES, {"amplifier": {"supply_voltage": 30.0}}),
    "slow_amplifier": Bearing(
        ratios(5e-6, 60e-6, 5, (1, 2, 3, 4, 5)),
        {
            "magnetic_circuit": {"air_gap": 0.4e-3, "turns_per_pole": 100},
            "amplifier": {"bias_current": 2.0, "supply_voltage": 150.0, "switching_frequency": 20e3},
            "rotor": {"mass": 3.0},
            "integration": {"sample_rate": 20e3},
        },
        {"proportional_gain": 12430.0, "derivative_gain": 11.0, "sample_rate": 20e3},
    ),
}


class Swept(Figures):
    """Where B, C and D begin in sweeps (Hz), by amplitude, and a mark at D where it is ordinary resonance."""

    b: list[float | None]
    c: list[float | None]
    d: list[float | None]
    d_mark: list[str]


class Dwelt(Figures):
    """Where B, C and D begin under fixed sines from one direction (Hz), by amplitude; None also where not bisected."""

    b: list[float | None]
    c: list[float | None]
    d: list[float | None]


class Confirmed(Figures):
    """Boundaries of a bearing by amplitude (um): sweeps of 20 and 40 s, fixed sines from below and from above."""

    amplitudes: list[float]
    sweeps: Swept
    slow_sweeps: Swept
    below: Dwelt
    above: Dwelt


class RegionMaps(Figures):
    """What `measure` returns; `gravity` and `no_gravity` are the paper's bearing at more amplitudes (um)."""

    paper: Confirmed
    supply_30_v: Confirmed
    slow_amplifier: Confirmed
    amplitudes: list[float]
    gravity: Swept
    no_gravity: Swept


SMALLEST: dict[str, Any] = {
    "amplitudes": 1,
    "settings": MapSettings(frequency_start=40.0, frequency_end=120.0, duration=0.5, resolution=1.0),
    "confirmation": ConfirmationSettings(dwell=1.0, ramp=0.05),
    "workers": 1,
}


def measure(
    amplitudes: int = len(PAPER_AMPLITUDES),
    settings: MapSettings | None = None,
    confirmation: ConfirmationSettings | None = None,
    workers: int | None = None,
) -> dict[str, object]:
    """Boundaries at the largest amplitudes of each bearing, as `RegionMaps` declares them."""
    settings, confirmation = settings or MapSettings(), confirmation or ConfirmationSettings()
    chosen = PAPER_AMPLITUDES[-amplitudes:]
    weightless = Bearing(chosen, {"rotor": {"gravity": 0.0}})
    return {
        **{
            name: _confirmed(bearing, bearing.amplitudes[-amplitudes:], settings, confirmation, workers)
            for name, bearing in BEARINGS.items()
        },
        "amplitudes": [UM * amplitude for amplitude in chosen],
        "gravity": as_swept(sweeps_of(BEARINGS["paper"], chosen, settings)),
        "no_gravity": as_swept(sweeps_of(weightless, chosen, settings)),
    }


def loop_of(bearing: Bearing) -> tuple[PlantParameters, ControllerParameters]:
    """Parameters of a bearing and its controller."""
    return validate(PlantParameters, bearing.plant), validate(ControllerParameters, bearing.controller)


def sweeps_of(bearing: Bearing, amplitudes: tuple[float, ...], settings: MapSettings) -> tuple[MapSweep, ...]:
    """The sweeps of a map of a bearing at some amplitudes (m)."""
    plant, controller = loop_of(bearing)
    return tuple(
        run_sweep(SweepTask(settings.sweep(amplitude), settings.rest, plant, controller, RegionParameters()))
        for amplitude in amplitudes
    )


def _confirmed(
    bearing: Bearing,
    amplitudes: tuple[float, ...],
    settings: MapSettings,
    confirmation: ConfirmationSettings,
    workers: int | None,
) -> dict[str, object]:
    plant, controller = loop_of(bearing)
    sweeps = sweeps_of(bearing, amplitudes, settings)
    with tempfile.TemporaryDirectory() as folder:
        swept = RegionMap(settings, sweeps, {}, True)
        region_map = confirm_map(swept, plant, controller, None, confirmation, cache=Path(folder), workers=workers)
    assert region_map.confirmation is not None
    return {
        "amplitudes": [UM * amplitude for amplitude in amplitudes],
        "sweeps": as_swept(sweeps),
        "slow_sweeps": as_swept(region_map.confirmation.sweeps),
        "below": _dwelt(region_map.confirmation, amplitudes, "below"),
        "above": _dwelt(region_map.confirmation, amplitudes, "above"),
    }


def as_swept(sweeps: tuple[MapSweep, ...]) -> dict[str, object]:
    """Where regions begin in sweeps, as `Swept` declares it."""
    begun = {
        region.name.lower(): [
            sweep.boundaries[region].frequency if region in sweep.boundaries else None for sweep in sweeps
        ]
        for region in BOUNDARIES
    }
    falls = [sweep.boundaries.get(Region.D) for sweep in sweeps]
    return {**begun, "d_mark": [RESONANCE if fall is not None and fall.resonance else "" for fall in falls]}


def _dwelt(confirmation: Confirmation, amplitudes: tuple[float, ...], direction: Direction) -> dict[str, object]:
    return {
        region.name.lower(): [_boundary(confirmation, region, amplitude, direction) for amplitude in amplitudes]
        for region in BOUNDARIES
    }


def _boundary(confirmation: Confirmation, region: Region, amplitude: float, direction: Direction) -> float | None:
    """The boundary under fixed sines (Hz) from a direction that reaches it."""
    dwell = confirmation.dwell(region, amplitude, direction)
    if dwell is None or not dwell.reached or math.isinf(dwell.frequency):
        return None
    return dwell.frequency
