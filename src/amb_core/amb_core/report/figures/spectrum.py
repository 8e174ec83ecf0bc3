"""Spectrum of the response to tones, its intermodulation products marked (the paper's Fig. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from amb_core.ground.units import UM
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Note, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, ORANGE, VERMILION, Marker, Stroke
from amb_core.report.figures.thinning import extremes

if TYPE_CHECKING:
    from amb_core.regions.subharmonics import Line, SubharmonicSpectrum

FLOOR = 1e-4  # um, below is nothing to see
SHOWN = 1e-2  # um, smallest line that is marked
LISTED = 12  # lines in the table of numbers, the largest ones
KINDS: dict[str, tuple[str, Marker]] = {
    "tone": (BLUE, "circle"),
    "product of the loop": (VERMILION, "diamond"),
    "product by sampling": (GREEN, "square"),
}


def spectrum_chart(
    spectra: Mapping[str, SubharmonicSpectrum], title: str = "Spectrum of the response to three tones"
) -> Chart:
    """Peak amplitude over frequency, a panel for each test, with tones, products and slow component marked.

    Parameters
    ----------
    spectra : mapping of str to SubharmonicSpectrum
        Tests by name, such as the tones as asked and shifted.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels, sentences = [], []
    rows: list[tuple[str, ...]] = []
    for name, spectrum in spectra.items():
        panels.append(_panel(name, spectrum))
        sentences.append(_sentence(name, spectrum))
        largest = sorted(spectrum.lines, key=lambda line: -abs(line.amplitude))[:LISTED]
        rows += [
            (name, f"{line.frequency:.2f}", f"{UM * abs(line.amplitude):.3g}", line.product.label, _kind(line))
            for line in largest
        ]
    table = Table(("test", "frequency (Hz)", "amplitude (µm)", "product", "kind"), tuple(rows))
    size = (8.0, 2.0 + 2.9 * len(panels))
    return Chart(title, " ".join(sentences), tuple(panels), shared_x=True, size=size, table=table)


def _panel(name: str, spectrum: SubharmonicSpectrum) -> Panel:
    marked = [line for line in spectrum.lines if UM * abs(line.amplitude) >= SHOWN]
    highest = max([1.0, *(UM * abs(line.amplitude) for line in marked)])
    items: list[Item] = []
    if spectrum.steps:
        x, y = extremes(np.log(spectrum.frequency[1:]), np.maximum(UM * spectrum.amplitude[1:], FLOOR))
        items.append(Curve(np.exp(x), y, "spectrum", Stroke(BLUE, width=0.8)))
    for kind, (colour, marker) in KINDS.items():
        lines = [line for line in marked if _kind(line) == kind]
        if lines:
            frequency = np.array([line.frequency for line in lines])
            amplitude = np.array([UM * abs(line.amplitude) for line in lines])
            hover = tuple(
                f"{line.frequency:.4g} Hz: {UM * abs(line.amplitude):.3g} µm, {line.product.label}" for line in lines
            )
            items.append(Points(frequency, amplitude, kind, colour, marker, hover=hover))
            items += [
                Note(line.frequency, 2.2 * UM * abs(line.amplitude), line.product.label)
                for line in lines
                if kind == "tone" or line is spectrum.line(-1, 1)
            ]
    slow = spectrum.slow
    if slow is not None and UM * slow.amplitude >= FLOOR:
        x, y = np.array([slow.frequency]), np.array([UM * slow.amplitude])
        hover = (f"{slow.frequency:.3g} Hz: {y[0]:.3g} µm, slow component",)
        items.append(Points(x, y, "slow component", ORANGE, "triangle", hover=hover))
    ends = (1.0 / (spectrum.steps * spectrum.sample_time) if spectrum.steps else 1.0, 0.5 / spectrum.sample_time)
    axis = spectrum.settings.axis
    return Panel(
        Axis("frequency (Hz)", log=True, limits=ends),
        Axis(f"{axis}, peak amplitude (µm)", log=True, limits=(FLOOR, 10.0 * highest)),
        tuple(items),
        f"{name}: {spectrum.state}",
    )


def _kind(line: Line) -> str:
    if line.product.order == 1:
        return "tone"
    return "product by sampling" if line.product.folds else "product of the loop"


def _sentence(name: str, spectrum: SubharmonicSpectrum) -> str:
    settings = spectrum.settings
    tones = ", ".join(
        f"{frequency:g} Hz at {UM * amplitude:g} µm"
        for frequency, amplitude in zip(settings.frequencies, settings.amplitudes, strict=True)
    )
    text = f"Test {name}: response on {settings.axis} to tones of {tones}; {spectrum.state}."
    difference = spectrum.line(-1, 1)
    if difference is not None:
        text += (
            f" The product f2 - f1 at {difference.frequency:g} Hz has {UM * abs(difference.amplitude):.3g} µm, "
            "which a linear bearing would not have."
        )
    if spectrum.slow is not None:
        text += f" The slow component has {UM * spectrum.slow.amplitude:.3g} µm at {spectrum.slow.frequency:.3g} Hz."
    return text
