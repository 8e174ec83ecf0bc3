"""An excitation superimposed on a region map (the paper's Fig. 11 and 12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from amb_core.ground.units import UM
from amb_core.regions import Region
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Points, Table
from amb_core.report.figures.region_map import AMPLITUDE, FREQUENCY, map_axes, region_items
from amb_core.report.figures.style import BLUE, Stroke, region_label, sentence

if TYPE_CHECKING:
    from amb_core.designs.excitation import AxisCheck, ExcitationCheck
    from amb_core.regions.region_map import RegionMap

HEARD = 1e-4  # share of the power below which a point is not drawn
REACH = 20.0  # factor by which the figure may go below the smallest amplitude of the map
FORMS = {"instantaneous": "the sweep", "lines": "its sines", "bands": "its thirds of an octave"}
ABBREVIATIONS = {"prbs": "PRBS"}


def overlay_chart(check: ExcitationCheck, region_map: RegionMap, title: str = "") -> Chart:
    """Regions over amplitude and frequency with the sines that an excitation consists of, a panel for each axis.

    Parameters
    ----------
    check : ExcitationCheck
        The excitation.
    region_map : RegionMap
        The map on which it was checked.
    title : str, optional
        Title of the figure; by default the kind of the excitation.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels = [_panel(axis, region_map) for axis in check.axes]
    rows = [
        (axis.axis, region_label(region), f"{100 * axis.shares[region]:.2f} %")
        for axis in check.axes
        for region in Region
    ]
    alt = (
        f"Spectrum of the excitation {check.kind} on the region map; power {_shares(check.shares)}. "
        f"Verdict: {check.verdict}."
    )
    columns = len(panels)
    kind = ABBREVIATIONS.get(check.kind, check.kind.replace("_", " "))
    heading = title or f"{sentence(kind)} on the region map"
    size = (8.0, 6.0) if columns == 1 else (11.5, 6.0)
    table = Table(("axis", "region", "share of the power"), tuple(rows))
    return Chart(heading, alt, tuple(panels), columns, size=size, table=table)


def _panel(axis: AxisCheck, region_map: RegionMap) -> Panel:
    horizontal, vertical = map_axes(region_map)
    assert horizontal.limits is not None and vertical.limits is not None
    heard = axis.share >= HEARD
    amplitude, frequency = UM * axis.amplitude[heard], axis.frequency[heard]
    low = min(horizontal.limits[0], max(0.8 * amplitude.min(), horizontal.limits[0] / REACH))
    high = max(horizontal.limits[1], 1.2 * amplitude.max())
    ends = (min(vertical.limits[0], 0.8 * frequency.min()), max(vertical.limits[1], frequency.max()))
    items: list[Item] = list(region_items(region_map, "dwell"))
    name = FORMS[axis.form]
    if axis.form == "instantaneous":
        items.append(Curve(amplitude, frequency, name, Stroke(BLUE, width=2.5)))
    else:
        x = np.column_stack([np.full(len(amplitude), low), amplitude, np.full(len(amplitude), np.nan)]).ravel()
        items.append(Curve(x, np.repeat(frequency, 3), "", Stroke(BLUE, width=0.8)))
    for covered in (True, False):
        chosen = axis.covered[heard] == covered
        if chosen.any() and (axis.form != "instantaneous" or not covered):
            hover = tuple(
                f"{a:.3g} µm, {f:.4g} Hz: {100 * share:.2g} % of the power, "
                + (region_label(Region(region)) if covered else "outside of the map")
                for a, f, share, region in zip(
                    amplitude[chosen],
                    frequency[chosen],
                    axis.share[heard][chosen],
                    axis.region[heard][chosen],
                    strict=True,
                )
            )
            label = name if covered else f"{name}, outside of the map"
            items.append(Points(amplitude[chosen], frequency[chosen], label, BLUE, "circle", covered, hover))
    return Panel(
        Axis(AMPLITUDE.replace(" of the reference", ""), log=True, limits=(low, high)),
        Axis(FREQUENCY, log=True, limits=ends),
        tuple(items),
        f"{axis.axis}: power {_shares(axis.shares)}",
    )


def _shares(shares: dict[Region, float]) -> str:
    return ", ".join(f"{100 * share:.0f} % in {region.name}" for region, share in shares.items() if share > 0.0)
