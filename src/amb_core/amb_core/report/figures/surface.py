"""Size of the lowest components over amplitude and frequency of the inducing tone (the paper's Fig. 7), as colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Heat, Item, Panel, Points, Table
from amb_core.report.figures.style import ORANGE, VERMILION, Marker

if TYPE_CHECKING:
    from amb_core.regions.subharmonics import SubharmonicSurface

SMALLEST = 1e-4  # um, lower end of the scale at the lowest


def surface_chart(surface: SubharmonicSurface, title: str = "Components that the inducing tone brings about") -> Chart:
    """Peak amplitude of the product f2 - f1 and of the slow component, one panel each, on one scale of colours.

    Parameters
    ----------
    surface : SubharmonicSurface
        The surface.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    frequency, amplitude = surface.inducing_frequency, UM * surface.inducing_amplitude
    parts = {"product f2 - f1": surface.difference, "slow component": surface.slow_amplitude}
    values = np.concatenate([UM * part[np.isfinite(part)] for part in parts.values()])
    highest = max(float(np.max(values, initial=0.0)), 10.0 * SMALLEST)
    limits = (max(SMALLEST, 1e-4 * highest), highest)
    marks: list[Item] = []
    kinds: tuple[tuple[tuple[str, ...], str, str, Marker], ...] = (
        (("drifting", "unsettled"), "no steady state", ORANGE, "circle"),
        (("delevitated",), "delevitated", VERMILION, "cross"),
    )
    for states, label, colour, marker in kinds:
        row, column = np.nonzero(np.isin(surface.state, states))
        if len(row):
            marks.append(Points(frequency[column], amplitude[row], label, colour, marker, filled=False))
    panels = tuple(
        Panel(
            Axis("frequency of the inducing tone (Hz)"),
            Axis("its amplitude (µm)"),
            (Heat(frequency, amplitude, np.clip(UM * part, *limits), limits, "peak amplitude", "µm"), *marks),
            name,
        )
        for name, part in parts.items()
    )
    sentences = [_sentence(name, part, surface) for name, part in parts.items()]
    steady = float(np.mean(surface.state == "steady"))
    alt = (
        f"Size of slow components over inducing tones of {amplitude[0]:.3g} to {amplitude[-1]:.3g} µm and "
        f"{frequency[0]:.0f} to {frequency[-1]:.0f} Hz; {100 * steady:.0f} % of the responses are steady. "
        + " ".join(sentences)
    )
    return Chart(title, alt, panels, shared_x=True, size=(8.0, 7.6), table=_table(surface))


def _sentence(name: str, part: NDArray[np.float64], surface: SubharmonicSurface) -> str:
    if not np.isfinite(part).any():
        return f"The {name} is nowhere known."
    row, column = np.unravel_index(np.nanargmax(part), part.shape)
    return (
        f"The {name} is largest, {UM * part[row, column]:.3g} µm, at "
        f"{UM * surface.inducing_amplitude[row]:.3g} µm and {surface.inducing_frequency[column]:.0f} Hz."
    )


def _table(surface: SubharmonicSurface) -> Table:
    rows = [
        (
            f"{UM * amplitude:.3g}",
            f"{frequency:.0f}",
            str(surface.state[row, column]),
            f"{UM * surface.difference[row, column]:.3g}",
            f"{UM * surface.slow_amplitude[row, column]:.3g}",
        )
        for row, amplitude in enumerate(surface.inducing_amplitude)
        for column, frequency in enumerate(surface.inducing_frequency)
    ]
    return Table(("amplitude (µm)", "frequency (Hz)", "state", "f2 - f1 (µm)", "slow (µm)"), tuple(rows))
