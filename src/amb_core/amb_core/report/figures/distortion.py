"""Linear response, noise and nonlinear distortions over frequency, an axis in each panel."""

from __future__ import annotations

import numpy as np

from amb_core.ground.units import UM
from amb_core.regions.distortion import Distortion
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Item, Panel, Points, Table, Values
from amb_core.report.figures.style import BLUE, GREEN, ORANGE, REFERENCE, VERMILION, Marker, sentence

FLOOR = 1e-6  # um, below is nothing to see


def distortion_chart(distortion: Distortion, title: str = "Linear response and nonlinear distortions") -> Chart:
    """Peak amplitudes of the lines in the position, in um, on logarithmic axes.

    Parameters
    ----------
    distortion : Distortion
        The measurement.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels, rows = [], []
    first = min(part[0] for part in (distortion.odd_frequency, distortion.frequency) if len(part))
    ends = (0.8 * first, 1.2 * distortion.frequency[-1])
    excited = "at excited lines" if distortion.method == "robust" else "beside excited lines"
    kinds: tuple[tuple[str, Values, Values, str, Marker], ...] = (
        ("linear response", distortion.frequency, distortion.linear, BLUE, "circle"),
        (f"distortion {excited}", distortion.frequency, distortion.stochastic, GREEN, "triangle"),
        ("odd distortion", distortion.odd_frequency, distortion.odd, ORANGE, "square"),
        ("even distortion", distortion.even_frequency, distortion.even, VERMILION, "diamond"),
        ("noise", distortion.frequency, distortion.noise, REFERENCE.colour, "cross"),
    )
    for axis, name in enumerate(distortion.axes):
        items: list[Item] = []
        for label, frequency, level, colour, marker in kinds:
            seen = UM * level[:, axis] > FLOOR
            if seen.any():
                items.append(Points(frequency[seen], UM * level[seen, axis], label, colour, marker, filled=False))
        heading = f"{name}: distortion {100.0 * distortion.ratio[axis]:.2g} %"
        if np.isnan(distortion.ratio[axis]):
            heading = f"{name}: not excited"
        across, up = Axis("frequency (Hz)", log=True, limits=ends), Axis(f"amplitude of {name} (µm)", log=True)
        panels.append(Panel(across, up, tuple(items), heading))
        rows += [
            (name, label, f"{100.0 * ratio[axis]:.3g}")
            for label, ratio in (
                ("all distortion", distortion.ratio),
                ("of even order", distortion.even_ratio),
                ("of odd order", distortion.odd_ratio),
                ("noise of one period", distortion.noise_ratio),
            )
            if np.isfinite(ratio[axis])
        ]
    highest = float(UM * np.max(distortion.linear))
    alt = f"Lines of the position: the linear response reaches {highest:.3g} µm. {sentence(distortion.summary)}."
    table = Table(("axis", "part", "share of the linear response (%)"), tuple(rows))
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 3.5 * len(panels)), table=table)
