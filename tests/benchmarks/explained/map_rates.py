"""What a map leaves open on two bearings with little voltage: the rate of its sweeps, and the way to a fixed sine.

Sweeps on y from 10 Hz to 5 kHz at three rates, and fixed sines that start at their frequency or come from below, as
those of `amb map --confirm`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from amb_core.ground.units import UM
from amb_core.regions import RegionParameters
from amb_core.regions.region_map import ConfirmationSettings, MapSettings
from amb_core.regions.region_map.dwell_run import DwellTask, run_dwell
from amb_core.regions.region_map.sweep_run import SweepTask
from tests.benchmarks.explained.region_maps import BEARINGS, Swept, as_swept, loop_of, sweeps_of
from tests.front_door.figures import Figures

RATES = (300.0, 100.0, 20.0)  # Hz/s
SWEPT = {"supply_30_v": (5e-6, 10e-6, 20e-6), "slow_amplifier": (10e-6, 15e-6, 25e-6)}  # m
HELD = {  # amplitude (m), frequencies (Hz)
    "supply_30_v": (5e-6, (400.0, 600.0, 800.0, 1000.0, 1200.0)),
    "slow_amplifier": (15e-6, (800.0, 1000.0, 1200.0, 1300.0)),
}


class AtRates(Figures):
    """Where regions begin in sweeps, by amplitude (um), of each rate (Hz/s)."""

    amplitudes: list[float]
    rates: list[float]
    sweeps: list[Swept]


class Held(Figures):
    """Region and displacement of the mean position (um) of fixed sines (Hz), by their way to the frequency."""

    amplitude: float
    frequencies: list[float]
    started: list[str]
    started_um: list[float]
    below: list[str]
    below_um: list[float]


class AllSwept(Figures):
    """Sweeps by bearing."""

    supply_30_v: AtRates
    slow_amplifier: AtRates


class AllHeld(Figures):
    """Fixed sines by bearing."""

    supply_30_v: Held
    slow_amplifier: Held


class MapRates(Figures):
    """What `measure` returns."""

    swept: AllSwept
    held: AllHeld


SMALLEST: dict[str, Any] = {
    "most": 1,
    "settings": MapSettings(frequency_start=40.0, frequency_end=120.0, resolution=1.0),
    "confirmation": ConfirmationSettings(dwell=1.0, ramp=0.05),
}


def measure(
    most: int = 9, settings: MapSettings | None = None, confirmation: ConfirmationSettings | None = None
) -> dict[str, object]:
    """Sweeps and fixed sines of at most so many amplitudes, rates and frequencies, as `MapRates` declares them."""
    settings, confirmation = settings or MapSettings(), confirmation or ConfirmationSettings()
    return {
        "swept": {
            name: _at_rates(name, amplitudes[:most], RATES[:most], settings) for name, amplitudes in SWEPT.items()
        },
        "held": {
            name: _held(name, amplitude, frequencies[:most], settings, confirmation)
            for name, (amplitude, frequencies) in HELD.items()
        },
    }


def _at_rates(
    name: str, amplitudes: tuple[float, ...], rates: tuple[float, ...], settings: MapSettings
) -> dict[str, object]:
    band = settings.frequency_end - settings.frequency_start
    sweeps = [
        sweeps_of(BEARINGS[name], amplitudes, settings.model_copy(update={"duration": band / rate})) for rate in rates
    ]
    return {
        "amplitudes": [UM * amplitude for amplitude in amplitudes],
        "rates": list(rates),
        "sweeps": [as_swept(one) for one in sweeps],
    }


def _held(
    name: str, amplitude: float, frequencies: tuple[float, ...], settings: MapSettings, times: ConfirmationSettings
) -> dict[str, object]:
    plant, controller = loop_of(BEARINGS[name])
    sweep = SweepTask(settings.sweep(amplitude), settings.rest, plant, controller, RegionParameters())
    tasks = [DwellTask(sweep, frequency, frequency, times) for frequency in frequencies]
    started = [run_dwell(task) for task in tasks]
    below = [run_dwell(replace(task, start=task.frequency / times.approach)) for task in tasks]
    return {
        "amplitude": UM * amplitude,
        "frequencies": list(frequencies),
        "started": [dwell.region.name for dwell in started],
        "started_um": [UM * dwell.displacement for dwell in started],
        "below": [dwell.region.name for dwell in below],
        "below_um": [UM * dwell.displacement for dwell in below],
    }
