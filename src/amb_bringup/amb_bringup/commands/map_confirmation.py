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


def confirmation_summary(found: RegionMap) -> dict[str, Any]:
    """The confirmation of a map as plain JSON values; a frequency at which nothing begins is null."""
    confirmation = found.confirmation
    if confirmation is None:
        return {}
    return {
        "complete": confirmation.complete,
        "settings": confirmation.settings.model_dump(),
        "other_sweep_rate": sweep_rate_text(found, confirmation.settings.rate_factor),
        "warnings": confirmation_warnings(found),
        "bands": [
            {"amplitude": sweep.amplitude, "boundaries": _band_entry(found, sweep.amplitude)} for sweep in found.sweeps
        ],
        "dwell_over_sweep": [_spread(band) for band in sweep_and_dwell(found)],
        "above_over_below": [_spread(band) for band in below_and_above(found)],
        "other_rate_over_sweep": [_spread(band) for band in two_rates(found)],
    }


def print_confirmation(found: RegionMap, console: Console) -> None:
    """Print the bands of a confirmed map, how far their sides lie apart, and the warnings."""
    confirmation = found.confirmation
    if confirmation is None:
        return
    console.print(_band_table(found))
    console.print(_spread_table(found))
    for text in confirmation_warnings(found):
        console.print(f"{text}", style="yellow")
    if not confirmation.complete:
        console.print("the confirmation is not complete", style="yellow")


def _band_entry(found: RegionMap, amplitude: float) -> dict[str, Any]:
    assert found.confirmation is not None
    entry: dict[str, Any] = {}
    other = {sweep.amplitude: sweep.boundaries for sweep in found.confirmation.sweeps}
    own = {sweep.amplitude: sweep.boundaries for sweep in found.sweeps}
    for region in BOUNDARIES:
        sides: dict[str, Any] = {}
        for name, swept in (("sweep", own), ("other_rate", other)):
            if region in swept.get(amplitude, {}):
                sides[name] = swept[amplitude][region].frequency
        for direction in DIRECTIONS:
            dwell = found.confirmation.dwell(region, amplitude, direction)
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


def _band_table(found: RegionMap) -> Table:
    table = Table(title="Boundaries (Hz): sweep, fixed sine from below, from above; - none, ? not reached")
    table.add_column("amplitude (um)", justify="right")
    for region in BOUNDARIES:
        table.add_column(region.name, justify="right")
    for sweep in found.sweeps:
        cells = [_sides(found, sweep.amplitude, region) for region in BOUNDARIES]
        table.add_row(f"{UM * sweep.amplitude:.2f}", *cells)
    return table


def _sides(found: RegionMap, amplitude: float, region: Region) -> str:
    assert found.confirmation is not None
    swept = next(sweep for sweep in found.sweeps if sweep.amplitude == amplitude).boundaries.get(region)
    dwells = [found.confirmation.dwell(region, amplitude, direction) for direction in DIRECTIONS]
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


def _spread_table(found: RegionMap) -> Table:
    table = Table("", "region", "amplitudes", "median", "range", "only one has it", title="How far they lie apart")
    for name, bands in (
        ("fixed sine / sweep", sweep_and_dwell(found)),
        ("from above / from below", below_and_above(found)),
        ("sweep at the other rate / sweep", two_rates(found)),
    ):
        for band in bands:
            ratio = band.ratio
            spread = (f"{np.median(ratio):.2f}", f"{ratio.min():.2f} to {ratio.max():.2f}") if len(ratio) else ("", "")
            only = band.only_first + band.only_second
            table.add_row(name, band.region.name, str(len(band.amplitude)), *spread, str(only) if only else "")
    return table
