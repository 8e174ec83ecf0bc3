"""The force of an electromagnet along trajectories: over time, and over the speed of the rotor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from amb_core.plant.force_law import ForceTrajectory
from amb_core.regions import Region
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Points, Table
from amb_core.report.figures.style import GREY, MODEL, PLANT, REGIONS, Stroke, region_label

SHOWN = 600  # points of a curve
SPEEDS = 250  # points of a trajectory over speed


def force_chart(trajectories: Mapping[Region, ForceTrajectory], title: str = "Force along trajectories") -> Chart:
    """Force over time in several regions, compared with eq. (4), which is omitted where the rotor hardly moves.

    Parameters
    ----------
    trajectories : mapping
        By the region in which the bearing runs.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels, rows = [], []
    for region, one in trajectories.items():
        every = max(1, len(one.time) // SHOWN)
        time = 1e3 * (one.time[::every] - one.time[0])
        curves = (
            Curve(time, one.force[::every], "force of the plant", PLANT),
            Curve(time, one.force_by_rates[::every], "right side of eq. (4)", MODEL),
        )
        panels.append(Panel(Axis("time (ms)"), Axis("force (N)"), curves, region_label(region)))
        error = np.nanmax(np.abs(one.force_by_rates / one.force - 1.0))
        rows.append((region_label(region), f"{one.force.min():.0f} to {one.force.max():.0f}", f"{error:.1e}"))
    table = Table(("region", "force (N)", "largest relative deviation of eq. (4)"), tuple(rows))
    alt = "Force of the upper electromagnet over time with the right side of the paper's eq. (4) drawn over it. " + (
        "; ".join(f"{name}: force {force} N, deviation up to {error}" for name, force, error in rows) + "."
    )
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 1.4 + 1.9 * len(panels)), table=table)


def force_speed_chart(
    trajectories: Mapping[Region, ForceTrajectory], title: str = "Force over the speed of the rotor"
) -> Chart:
    """Force over speed, both logarithmic, with the line that inverse proportionality would follow.

    Parameters
    ----------
    trajectories : mapping
        By the region in which the bearing runs.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    items: list[Curve | Points] = []
    rows = []
    for region, one in trajectories.items():
        places = np.flatnonzero(one.moving)
        places = places[:: max(1, len(places) // SPEEDS)]
        look = REGIONS[region]
        speed = 1e3 * np.abs(one.gap_rate[places])
        label = f"{region_label(region)}: exponent {one.speed_exponent:+.2f}"
        items.append(Points(speed, one.force[places], label, look.colour, look.marker, filled=False))
        rows.append((region_label(region), f"{speed.min():.2g} to {speed.max():.2g}", f"{one.speed_exponent:+.2f}"))
    speeds = np.concatenate([item.x for item in items])
    forces = np.concatenate([item.y for item in items])
    ends = np.geomspace(speeds.min(), speeds.max(), 2)
    centre = np.exp(np.log(forces).mean()) * np.exp(np.log(speeds).mean())
    items.append(Curve(ends, centre / ends, "inversely proportional: exponent -1", Stroke(GREY, "dash", 1.6)))
    table = Table(("region", "speed of the gap (mm/s)", "exponent"), tuple(rows))
    alt = "Force of the upper electromagnet over the speed at which its gap changes. Exponents of the power laws: " + (
        ", ".join(f"{name} {exponent}" for name, _, exponent in rows) + "; inverse proportionality would have -1."
    )
    vertical = Axis("force (N)", log=True, limits=(0.8 * float(forces.min()), 1.25 * float(forces.max())))
    panel = Panel(Axis("speed of the gap (mm/s)", log=True), vertical, tuple(items))
    return Chart(title, alt, (panel,), size=(8.0, 5.4), table=table)
