"""The region map (the paper's frequency-amplitude graph, Fig. 8 and 9), and grids of maps as small multiples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.regions.region_map import BOUNDARIES, RegionMap, Side, sweep_and_dwell
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Band, Curve, HoverGrid, Item, Note, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, GREY, REGIONS, Stroke, region_label

if TYPE_CHECKING:
    from amb_core.regions.region_map import AnalyticLine, GridCell

POINTS = 300  # amplitudes at which boundaries are drawn
HOVER = (60, 90)  # amplitudes and frequencies at which a page shows the region
LETTER_ROOM = 0.12  # decades of frequency that a region must span to have its letter in it
AMPLITUDE = "amplitude of the reference (µm)"
FREQUENCY = "input frequency (Hz)"
LINES = (Stroke(BLUE, "dash", 1.6), Stroke(GREEN, "dot", 2.2), Stroke(GREY, "dashdot", 1.8), Stroke(BLUE, width=1.0))
BEATS = Stroke(GREY, width=3.0)


def map_chart(region_map: RegionMap, lines: Sequence[AnalyticLine] = (), title: str = "") -> Chart:
    """Regions over amplitude and frequency: simulated onsets, boundaries between them, and analytic lines.

    Parameters
    ----------
    region_map : RegionMap
        The map.
    lines : sequence of AnalyticLine, optional
        From `amb_core.regions.region_map.analytic_lines`; shown within the map's amplitudes and frequencies.
    title : str, optional
        Title of the figure; by default what the map shows.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    title = title or ("Region map by sweeps and by fixed sines" if region_map.confirmation else "Region map")
    drawn = [
        Curve(UM * line.amplitude, line.frequency, line.name, LINES[number % len(LINES)])
        for number, line in enumerate(lines)
    ]
    items = (*_hover(region_map), *region_items(region_map), *dwell_items(region_map), *drawn, *_simulated(region_map))
    panel = Panel(*map_axes(region_map), items)
    return Chart(title, _alt(region_map), (panel,), size=(8.0, 6.2), table=_table(region_map))


def map_grid_chart(cells: Sequence[GridCell], title: str = "Region maps over parameters of the design") -> Chart:
    """Small multiples: the maps of a grid, all with the same axes; the last parameter varies from left to right.

    Parameters
    ----------
    cells : sequence of GridCell
        From `amb_core.regions.region_map.build_grid`, at least one with a map.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    last = list(cells[0].values)[-1]
    columns = min(len(dict.fromkeys(str(cell.values[last]) for cell in cells)), 4)
    first = next(cell.map for cell in cells if cell.map is not None)
    horizontal, vertical = map_axes(first)
    assert horizontal.limits is not None and vertical.limits is not None
    centre = (math.sqrt(math.prod(horizontal.limits)), math.sqrt(math.prod(vertical.limits)))
    panels, parts = [], []
    for number, cell in enumerate(cells):
        heading = ", ".join(f"{name.rsplit('.', 1)[-1]} {_plain(value)}" for name, value in cell.values.items())
        items = [Note(*centre, "no map")] if cell.map is None else [*_hover(cell.map), *region_items(cell.map)]
        labelled = vertical if number % columns == 0 else replace(vertical, label="")
        panels.append(Panel(horizontal, labelled, tuple(items), heading))
        parts.append(f"{heading}: {'no map' if cell.map is None else _ranges(cell.map)}.")
    rows = -(-len(panels) // columns)
    size = (1.2 + 3.2 * columns, 1.2 + 2.8 * rows)
    alt = f"Regions over amplitude and input frequency, for {len(cells)} designs. {' '.join(parts)}"
    return Chart(title, alt, tuple(panels), columns, shared_x=True, size=size)


def map_axes(region_map: RegionMap) -> tuple[Axis, Axis]:
    """Amplitude and frequency of a map, both logarithmic."""
    settings = region_map.settings
    amplitudes = (float(UM * region_map.amplitudes[0]), float(UM * region_map.amplitudes[-1]))
    if amplitudes[0] == amplitudes[1]:  # a single sweep: an axis needs a length
        amplitudes = (amplitudes[0] / 1.1, amplitudes[1] * 1.1)
    return (
        Axis(AMPLITUDE, log=True, limits=amplitudes),
        Axis(FREQUENCY, log=True, limits=(settings.frequency_start, settings.frequency_end)),
    )


def region_items(region_map: RegionMap, side: Side = "sweep") -> list[Item]:
    """The regions as areas, the boundaries between them as lines, and a letter in each region."""
    horizontal, vertical = map_axes(region_map)
    assert horizontal.limits is not None and vertical.limits is not None
    amplitude = np.geomspace(*horizontal.limits, POINTS)
    edges = _lower_edges(region_map, amplitude / UM, vertical.limits, side)
    areas: list[Item] = []
    boundaries: list[Item] = []
    letters: list[Item] = []
    for region, low, high in zip(Region, edges[:-1], edges[1:], strict=True):
        height = np.log10(high / low)
        if not np.any(height > 0.0):
            continue
        look = REGIONS[region]
        areas.append(Band(amplitude, low, high, region_label(region), look.colour, look.hatch))
        if region is not Region.A:
            line = np.where((height > 0.0) & (low > vertical.limits[0]), low, np.nan)
            boundaries.append(Curve(amplitude, line, f"{region.name} begins", look.boundary))
        if height.max() > LETTER_ROOM:
            tall = np.flatnonzero(height > 0.8 * height.max())
            column = tall[len(tall) // 2]
            letters.append(Note(float(amplitude[column]), math.sqrt(low[column] * high[column]), region.name))
    return [*areas, *boundaries, *letters]


def _lower_edges(
    region_map: RegionMap, amplitude: NDArray[np.float64], ends: tuple[float, float], side: Side
) -> list[NDArray[np.float64]]:
    """Lower ends of the regions (Hz) at amplitudes (m), and the top, shape (5, n); higher regions come first."""
    edges = [np.full(amplitude.shape, ends[1])]
    for region in reversed(BOUNDARIES):
        edges.append(np.minimum(np.clip(region_map.boundary(region, amplitude, side), *ends), edges[-1]))
    return [np.full(amplitude.shape, ends[0]), *reversed(edges)]


def dwell_items(region_map: RegionMap) -> list[Item]:
    """Boundaries under fixed sines, and the bands between them and the boundaries of the sweeps."""
    items: list[Item] = []
    for band in sweep_and_dwell(region_map):
        look, name = REGIONS[band.region], band.region.name
        x = UM * band.amplitude
        ends = np.array([_ends(region_map, amplitude) for amplitude in band.amplitude]).T
        swept, dwelt = np.where(np.isnan([band.first, band.second]), ends, [band.first, band.second])
        label = f"{name}, sweep to fixed sine"
        items.append(Band(x, np.minimum(swept, dwelt), np.maximum(swept, dwelt), label, look.colour, "\\"))
        begins = np.isfinite(band.second)
        hover = tuple(
            f"{a:.3g} µm, {f:.0f} Hz: {region_label(band.region)} begins under a fixed sine"
            for a, f in zip(x[begins], band.second[begins], strict=True)
        )
        items.append(Points(x[begins], band.second[begins], f"{name}, fixed sine", look.colour, "cross", True, hover))
    return items


def _ends(region_map: RegionMap, amplitude: float) -> tuple[float, float]:
    """Frequencies at which the sweep and the fixed sines of an amplitude end: where the rotor falls, else the map's."""
    swept = next(sweep.highest_frequency for sweep in region_map.sweeps if sweep.amplitude == amplitude)
    fallen = region_map.confirmation and region_map.confirmation.frequency(Region.D, amplitude)
    top = region_map.settings.frequency_end
    return min(swept, top), min(fallen or math.inf, top)


def _simulated(region_map: RegionMap) -> list[Item]:
    """Onsets in the sweeps, those by ordinary resonance hollow, and the beats."""
    items: list[Item] = []
    plain = "simulated" if region_map.confirmation is None else "sweep"
    for region in BOUNDARIES:
        for resonance in (False, True):
            onsets = [
                (UM * sweep.amplitude, sweep.boundaries[region].frequency)
                for sweep in region_map.sweeps
                if region in sweep.boundaries and sweep.boundaries[region].resonance == resonance
            ]
            if onsets:
                how = f"{region.name}, by resonance" if resonance else f"{region.name}, {plain}"
                hover = tuple(
                    f"{amplitude:.3g} µm, {frequency:.0f} Hz: {region_label(region)} begins"
                    + (" (ordinary resonance)" if resonance else "")
                    for amplitude, frequency in onsets
                )
                look = REGIONS[region]
                x, y = np.array(onsets).T
                items.append(Points(x, y, how, look.colour, look.marker, not resonance, hover))
    spans = [(UM * sweep.amplitude, *span) for sweep in region_map.sweeps for span in sweep.beats]
    if spans:
        x = np.ravel([[amplitude, amplitude, np.nan] for amplitude, _, _ in spans])
        y = np.ravel([[low, max(high, 1.01 * low), np.nan] for _, low, high in spans])
        items.append(Curve(x, y, "input beats with the sample rate", BEATS))
    return items


def _hover(region_map: RegionMap) -> list[Item]:
    """What a page shows at any place: amplitude, frequency and region."""
    horizontal, vertical = map_axes(region_map)
    assert horizontal.limits is not None and vertical.limits is not None
    amplitude, frequency = np.geomspace(*horizontal.limits, HOVER[0]), np.geomspace(*vertical.limits, HOVER[1])
    regions = region_map.region_at(frequency[:, None], amplitude[None, :] / UM)
    return [HoverGrid(amplitude, frequency, regions, tuple(map(region_label, Region)), ("µm", "Hz"))]


def _alt(region_map: RegionMap) -> str:
    low, high = UM * region_map.amplitudes[[0, -1]]
    return (
        f"Regions over the amplitude of the reference, {low:.3g} to {high:.3g} µm, and the input frequency. "
        f"As the amplitude rises, {_ranges(region_map)}."
        + (" Shaded bands: from the boundary of the sweeps to that of fixed sines." if region_map.confirmation else "")
    )


def _ranges(region_map: RegionMap) -> str:
    """The frequencies of the boundaries from the smallest to the largest amplitude that has them, as text."""
    parts = []
    for region in BOUNDARIES:
        known = region_map.frequencies(region)
        known = known[np.isfinite(known)]
        if len(known):
            ends = dict.fromkeys(f"{frequency:.0f}" for frequency in known[[0, -1]])
            where = f"at {next(iter(ends))} Hz" if len(ends) == 1 else f"from {' to '.join(ends)} Hz"
            parts.append(f"{region_label(region)} begins {where}")
    return ", ".join(parts) or f"all of it is region {region_label(Region.A)}"


def _table(region_map: RegionMap) -> Table:
    rows = []
    for sweep in region_map.sweeps:
        cells = [
            f"{sweep.boundaries[region].frequency:.0f}" + (" (resonance)" if sweep.boundaries[region].resonance else "")
            if region in sweep.boundaries
            else ""
            for region in BOUNDARIES
        ]
        rows.append((f"{UM * sweep.amplitude:.3g}", *cells, *_dwell_cells(region_map, sweep.amplitude)))
    fixed = [f"{region.name} with fixed sines (Hz)" for region in BOUNDARIES if region_map.confirmation is not None]
    return Table(("amplitude (µm)", *(f"{region.name} from (Hz)" for region in BOUNDARIES), *fixed), tuple(rows))


def _dwell_cells(region_map: RegionMap, amplitude: float) -> list[str]:
    if region_map.confirmation is None:
        return []
    frequencies = [region_map.confirmation.frequency(region, amplitude) for region in BOUNDARIES]
    return ["" if one is None else "none" if math.isinf(one) else f"{one:.0f}" for one in frequencies]


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
