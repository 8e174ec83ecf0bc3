"""Coherence of the position with the references over frequency, an axis in each panel."""

from __future__ import annotations

import numpy as np

from amb_core.regions.distortion import Coherence
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import PLANT

LOW_ENDS = (0.9, 0.5, 0.0)
"""Of the scale, the first below all values: close to 1, 0.99 and 0.98 differ, as 10 and 14 % of noise do."""


def coherence_chart(coherence: Coherence, title: str = "Coherence of position and reference") -> Chart:
    """The part of the power that a linear response to the references explains, between 0 and 1.

    Parameters
    ----------
    coherence : Coherence
        The measurement.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    frequency = coherence.frequency
    across = Axis("frequency (Hz)", log=True, limits=(0.8 * frequency[0], 1.2 * frequency[-1]))
    panels, rows, lowest = [], [], []
    for axis, name in enumerate(coherence.axes):
        if np.isnan(coherence.ratio[axis]):
            continue
        values, ratio = coherence.coherence[:, axis], 100.0 * coherence.ratio[axis]
        heading = f"{name}: noise and distortion together {ratio:.2g} % of the explained motion"
        curve = Curve(frequency, values, "coherence", PLANT)
        low = next(low for low in LOW_ENDS if low < np.min(values) or low == 0.0)
        limits = (low, 1.0 + 0.05 * (1.0 - low))
        panels.append(Panel(across, Axis(f"coherence of {name} (-)", limits=limits), (curve,), heading))
        lowest.append(f"{np.min(values):.3f} on {name} at {frequency[np.argmin(values)]:.4g} Hz")
        rows.append((name, f"{coherence.overall[axis]:.4f}", f"{np.min(values):.4f}", f"{ratio:.3g}"))
    table = Table(("axis", "coherence", "lowest of a band", "noise and distortion (%)"), tuple(rows))
    alt = f"Coherence over frequency, from {frequency[0]:.4g} to {frequency[-1]:.4g} Hz; lowest: {', '.join(lowest)}."
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 3.0 * max(2, len(panels))), table=table)
