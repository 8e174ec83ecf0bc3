"""How late the steps of paced nodes came."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, Stroke

JOINED = 4  # bins of a report in one of the figure: twelve a decade
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)


def lateness_chart(
    nodes: Mapping[str, tuple[NDArray[np.float64], NDArray[np.int64]]], title: str = "Lateness of paced steps"
) -> Chart:
    """Histogram of the lateness of each node, on logarithmic axes.

    Parameters
    ----------
    nodes : mapping
        Edges (s), shape (bins + 1,), and counts, shape (bins,), by name of the node; see `amb_core.loop.pace`.
    title : str
        Title of the figure.
    """
    curves, rows = [], []
    for number, (name, (edges, counts)) in enumerate(nodes.items()):
        if not counts.any():
            continue
        starts = np.arange(0, len(counts), JOINED)
        edges, counts = np.append(edges[starts], edges[-1]), np.add.reduceat(counts, starts)
        seen = counts > 0
        share = np.where(seen, 100.0 * counts / counts.sum(), np.nan)
        outline = 1e6 * np.repeat(edges, 2)[1:-1]
        curves.append(Curve(outline, np.repeat(share, 2), name, Stroke(_COLOURS[number % len(_COLOURS)])))
        rows.append((name, str(counts.sum()), f"{1e6 * edges[1:][seen][-1]:.3g}"))
    longest = ", ".join(f"{name}: {latest} us" for name, _, latest in rows)
    alt = f"Histogram of the lateness on logarithmic axes. Upper edge of the last bin of {longest}."
    share_of_bin = Axis("share of the deadlines in a bin (%)", log=True)
    panel = Panel(Axis("lateness (us)", log=True), share_of_bin, tuple(curves))
    return Chart(title, alt, (panel,), table=Table(("node", "deadlines", "latest (us)"), tuple(rows)))
