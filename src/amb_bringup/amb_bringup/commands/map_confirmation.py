"""What `amb map --confirm` reports: sweep and dwell boundaries as bands, and what depends on the rate of the sweeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.regions.region_map import (
    BOUNDARIES,
    DIRECTIONS,
    BoundaryBand,
    DwellBoundary,
    RegionMap,
    below_and_above,
    confirmation_warnings,
    sweep_and_dwell,
    sweep_rate_text,
    two_rates,
)


def confirmation_summary(region_map: RegionMap) -> dict[str, Any]:
    """The confirmation of a map as plain JSON values; a frequency at which nothing begins is null."""
    confirmation = region_map.confirmation
    if confirmation is None:
        return {}
    return {
        "complete": confirmation.complete,
        "settings": confirmation.settings.model_dump(),
        "other_sweep_rate": sweep_rate_text(region_map, confirmation.settings.rate_factor),
        "warnings": confirmation_warnings(region_map),
        "bands": [
            {"amplitude": sweep.amplitude, "boundaries": _band_entry(region_map, sweep.amplitude)}
            for sweep in region_map.sweeps
        ],
        "dwell_over_sweep": [_spread(band) for band in sweep_and_dwell(region_map)],
        "above_over_below": [_spread(band) for band in below_and_above(region_map)],
        "other_rate_over_sweep": [_spread(band) for band in two_rates(region_map)],
    }


def print_confirmation(region_map: RegionMap, console: Console) -> None:
    """Print the bands of a confirmed map, how far their sides lie apart, and the warnings."""
    confirmation = region_map.confirmation
    if confirmation is None:
        return
    console.print(_band_table(region_map))
    console.print(_spread_table(region_map))
    for text in confirmation_warnings(region_map):
        console.print(f"{text}", style="yellow")
    if not confirmation.complete:
        console.print("the confirmation is not complete", style="yellow")


def _band_entry(region_map: RegionMap, amplitude: float) -> dict[str, Any]:
    assert region_map.confirmation is not None
    entry: dict[str, Any] = {}
    other = {sweep.amplitude: sweep.boundaries for sweep in region_map.confirmation.sweeps}
    own = {sweep.amplitude: sweep.boundaries for sweep in region_map.sweeps}
    for region in BOUNDARIES:
        sides: dict[str, Any] = {}
        for name, swept in (("sweep", own), ("other_rate", other)):
            if region in swept.get(amplitude, {}):
                sides[name] = swept[amplitude][region].frequency
        for direction in DIRECTIONS:
            dwell = region_map.confirmation.dwell(region, amplitude, direction)
            if dwell is not None:
                sides[f"dwell_{direction}"] = _bracket(dwell)
        if sides:
            entry[region.name] = sides
    return entry


def _bracket(dwell: DwellBoundary) -> dict[str, Any]:
    return {
        "low": dwell.low or None,
        "high": dwell.high,
        "reached": dwell.reached,
    }


def _spread(band: BoundaryBand) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "region": band.region.name,
        "amplitudes": len(band.amplitude),
        "moved_more_than_10_percent": band.moved,
        "only_first": band.only_first,
        "only_second": band.only_second,
    }
    if len(band.ratio):
        entry |= {
            "median_ratio": np.median(band.ratio),
            "smallest_ratio": band.ratio.min(),
            "largest_ratio": band.ratio.max(),
        }
    return entry


def _band_table(region_map: RegionMap) -> Table:
    table = Table(title="Boundaries (Hz): sweep, fixed sine from below, from above; - none, ? not reached")
    table.add_column("amplitude (um)", justify="right")
    for region in BOUNDARIES:
        table.add_column(region.name, justify="right")
    for sweep in region_map.sweeps:
        cells = [_sides(region_map, sweep.amplitude, region) for region in BOUNDARIES]
        table.add_row(f"{UM * sweep.amplitude:.2f}", *cells)
    return table


def _sides(region_map: RegionMap, amplitude: float, region: Region) -> str:
    assert region_map.confirmation is not None
    swept = next(sweep for sweep in region_map.sweeps if sweep.amplitude == amplitude).boundaries.get(region)
    dwells = [region_map.confirmation.dwell(region, amplitude, direction) for direction in DIRECTIONS]
    if swept is None and not any(dwells):
        return ""
    texts = ["-" if swept is None else f"{swept.frequency:.0f}"]
    for dwell in dwells:
        if dwell is None:
            texts.append("")
        elif not dwell.reached:
            texts.append("?")
        else:
            texts.append("-" if math.isinf(dwell.frequency) else f"{dwell.frequency:.0f}")
    return ", ".join(texts)


def _spread_table(region_map: RegionMap) -> Table:
    table = Table("", "region", "amplitudes", "median", "range", "only one has it", title="How far they lie apart")
    for name, bands in (
        ("fixed sine / sweep", sweep_and_dwell(region_map)),
        ("from above / from below", below_and_above(region_map)),
        ("sweep at the other rate / sweep", two_rates(region_map)),
    ):
        for band in bands:
            ratio = band.ratio
            spread = (f"{np.median(ratio):.2f}", f"{ratio.min():.2f} to {ratio.max():.2f}") if len(ratio) else ("", "")
            only = band.only_first + band.only_second
            table.add_row(name, band.region.name, str(len(band.amplitude)), *spread, str(only) if only else "")
    return table
