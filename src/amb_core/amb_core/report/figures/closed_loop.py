"""Response of each axis to its own reference over frequency, measured and of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import MODEL, PLANT
from amb_core.rig.commissioning import ClosedLoop


def closed_loop_chart(
    loops: Sequence[ClosedLoop],
    models: Sequence[NDArray[np.complex128]] | None = None,
    title: str = "Response of the closed loop",
) -> Chart:
    """Magnitude of position over reference, an axis in each panel.

    Parameters
    ----------
    loops : sequence of ClosedLoop
        Measured, one for each axis.
    models : sequence of ndarray, shape (f,), optional
        Response of a model at the frequencies of each axis.
    title : str
        Title of the figure.
    """
    panels, texts, rows = [], [], []
    for number, loop in enumerate(loops):
        curves = [Curve(loop.frequency, np.abs(loop.response), "measured", PLANT)]
        if models is not None:
            curves.append(Curve(loop.frequency, np.abs(models[number]), "model of the parameter file", MODEL))
        pair = f"{loop.resonance.natural_hz:.1f} Hz", f"{loop.resonance.damping_ratio:.3f}"
        panels.append(
            Panel(
                Axis("frequency (Hz)", log=True),
                Axis(f"{loop.axis} over its reference (-)"),
                tuple(curves),
                f"{loop.axis}: natural frequency {pair[0]}, damping ratio {pair[1]}",
            )
        )
        texts.append(f"{loop.axis} has its resonance at {pair[0]} with a damping ratio of {pair[1]}.")
        rows.append((loop.axis, *pair))
    table = Table(("axis", "natural frequency", "damping ratio"), tuple(rows))
    size = 8.0, 2.8 * len(panels) + 0.4
    return Chart(title, " ".join(texts), tuple(panels), shared_x=True, size=size, table=table)
