"""Stability chart over K_P and K_D: the stable set, lines of equal peak sensitivity, and the chosen gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from amb_core.ground.extras import extra
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Heat, Item, Panel, Points, Table, Values
from amb_core.report.figures.style import GREEN, ORANGE, PURPLE, VERMILION, Stroke

if TYPE_CHECKING:
    from amb_core.designs.tuning.stability_chart import StabilityChart

with extra("figures"):
    from matplotlib.figure import Figure

LINES = {2.0: Stroke(GREEN), 3.0: Stroke(ORANGE, "dash"), 4.0: Stroke(VERMILION, "dashdot")}
SCALE = 1.0, 10.0
"""Ends of the colours; what is beyond has the last one."""


def stability_figure(chart: StabilityChart, title: str = "Gains that hold the rotor") -> Chart:
    """The chart: colours where the loop is stable, lines of the peak sensitivities 2, 3 and 4.

    Parameters
    ----------
    chart : StabilityChart
        The chart.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    k_p, k_d = 1e-3 * chart.proportional, chart.derivative
    stable = np.isfinite(chart.peak)
    values = np.where(stable, np.clip(chart.peak, *SCALE), np.nan)
    items: list[Item] = [Heat(k_p, k_d, values, SCALE, "peak sensitivity", "-")]
    for level, stroke in LINES.items():
        x, y = _line(chart, level)
        if len(x):
            items.append(Curve(x, y, f"peak sensitivity {level:g}", stroke))
    known = np.isfinite(chart.chosen_peak)
    words = f"peak sensitivity {chart.chosen_peak:.3g}" if known else "unstable"
    gains = np.array([1e-3 * chart.chosen[0]]), np.array([chart.chosen[1]])
    if chart.alike:
        items.append(Points(*gains, f"chosen: {words}", PURPLE, "diamond" if known else "cross"))
        controller = f"Chosen are {gains[0][0]:.4g} A/mm and {gains[1][0]:.4g} A s/m, {words}."
    else:
        controller = (
            f"The axes have gains of their own, {words}; the chart has those of {chart.axis} on all, "
            "and the controller is no point of it."
        )
    alt = (
        f"Stable set of the loop over K_P from {k_p[0]:.3g} to {k_p[-1]:.3g} A/mm and K_D from "
        f"{k_d[0]:.3g} to {k_d[-1]:.3g} A s/m: "
        f"{100.0 * stable.mean():.0f} % of the gains shown are stable. {controller}"
    )
    along = Axis("K_P (A/mm)", log=True, limits=(k_p[0], k_p[-1]))
    up = Axis("K_D (A s/m)", log=True, limits=(k_d[0], k_d[-1]))
    panel = Panel(along, up, tuple(items))
    return Chart(title, alt, (panel,), size=(8.0, 5.4), table=_table(chart))


def _line(chart: StabilityChart, level: float) -> tuple[Values, Values]:
    """Points of the lines of a level, with NaN between them; the boundary of the stable set is above every level."""
    peak = np.where(np.isfinite(chart.peak), np.minimum(chart.peak, 100.0), 100.0)
    axes = Figure().subplots()
    lines = axes.contour(1e-3 * chart.proportional, chart.derivative, np.log(peak), [np.log(level)]).allsegs[0]
    if not len(lines):
        return np.empty(0), np.empty(0)
    joined = np.concatenate([np.vstack([line, [[np.nan, np.nan]]]) for line in lines])
    return joined[:-1, 0], joined[:-1, 1]


def _table(chart: StabilityChart) -> Table:
    """For each K_P: the range of K_D that is stable, and that with a peak of at most 3."""
    rows = []
    for column, gain in enumerate(chart.proportional):
        peak = chart.peak[:, column]
        ranges = [_range(chart.derivative[peak < np.inf]), _range(chart.derivative[peak <= 3.0])]
        rows.append((f"{1e-3 * gain:.4g}", *ranges))
    return Table(("K_P (A/mm)", "K_D stable (A s/m)", "K_D with a peak of at most 3 (A s/m)"), tuple(rows))


def _range(values: Values) -> str:
    return f"{values.min():.4g} to {values.max():.4g}" if len(values) else "none"
