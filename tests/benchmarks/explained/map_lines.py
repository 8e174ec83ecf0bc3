"""The analytic lines of the paper's bearing over the boundaries of its map, with and without gravity.

Sweeps are those of `amb map` on y, 10 Hz to 5 kHz in 20 s, at 25 amplitudes from 5 to 100 um.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.regions.region_map import MapSettings, RegionMap
from amb_core.regions.region_map.compare import Comparison, analytic_lines, compare
from tests.benchmarks.explained.region_maps import BEARINGS, Bearing, loop_of, ratios, sweeps_of
from tests.front_door.figures import Figures

AMPLITUDES = ratios(5e-6, 100e-6, 24, tuple(range(25)))  # m
SMALL = 40e-6  # m; at larger amplitudes the bandwidth of the loop is near the line


class Ratio(Figures):
    """Frequency of a line over that of a boundary, at so many sweeps from an amplitude to another (um)."""

    sweeps: int
    from_um: float
    to_um: float
    median: float
    least: float
    largest: float


class OverBoundaries(Figures):
    """A line over the boundaries of B and D; None where no sweep has both."""

    b: Ratio | None
    d: Ratio | None


class MapLines(Figures):
    """What `measure` returns, by line."""

    static_load_small: OverBoundaries
    static_load_large: OverBoundaries
    bias: OverBoundaries
    slew: OverBoundaries
    gain_loss: OverBoundaries
    bias_no_gravity: OverBoundaries
    gain_loss_no_gravity: OverBoundaries


SMALLEST: dict[str, Any] = {
    "amplitudes": 1,
    "settings": MapSettings(frequency_start=40.0, frequency_end=400.0, duration=0.5, resolution=1.0),
}


def measure(amplitudes: int = len(AMPLITUDES), settings: MapSettings | None = None) -> dict[str, object]:
    """Lines over boundaries at the largest of the amplitudes, as `MapLines` declares them."""
    settings, chosen = settings or MapSettings(), AMPLITUDES[-amplitudes:]
    loaded = _comparisons(BEARINGS["paper"], chosen, settings)
    weightless = _comparisons(Bearing(chosen, {"rotor": {"gravity": 0.0}}), chosen, settings)
    return {
        "static_load_small": _over(loaded, "static-load limit", to=SMALL),
        "static_load_large": _over(loaded, "static-load limit", above=SMALL),
        "bias": _over(loaded, "bias limit"),
        "slew": _over(loaded, "slew limit"),
        "gain_loss": _over(loaded, "gain-loss limit"),
        "bias_no_gravity": _over(weightless, "bias limit"),
        "gain_loss_no_gravity": _over(weightless, "gain-loss limit"),
    }


def _comparisons(bearing: Bearing, amplitudes: tuple[float, ...], settings: MapSettings) -> list[Comparison]:
    region_map = RegionMap(settings, sweeps_of(bearing, amplitudes, settings), {}, True)
    return compare(region_map, analytic_lines(*loop_of(bearing)))


def _over(comparisons: list[Comparison], line: str, above: float = 0.0, to: float = np.inf) -> dict[str, object]:
    found = {one.region: one for one in comparisons if one.line == line}
    return {
        region.name.lower(): _ratio(found[region], above, to) if region in found else None
        for region in (Region.B, Region.D)
    }


def _ratio(comparison: Comparison, above: float, to: float) -> dict[str, object] | None:
    within = (comparison.amplitude > above) & (comparison.amplitude <= to)
    if not within.any():
        return None
    amplitude, ratio = UM * comparison.amplitude[within], comparison.ratio[within]
    return {
        "sweeps": len(ratio),
        "from_um": float(amplitude.min()),
        "to_um": float(amplitude.max()),
        "median": float(np.median(ratio)),
        "least": float(ratio.min()),
        "largest": float(ratio.max()),
    }
