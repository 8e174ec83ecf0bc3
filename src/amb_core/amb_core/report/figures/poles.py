"""Poles of an identified plant and of its closed loop in the z plane, with confidence regions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, REFERENCE, VERMILION, Stroke

if TYPE_CHECKING:
    from amb_core.identification import Identification

LEVEL = 0.99
DETAIL = 0.1  # half the width of the part around z = 1 that is drawn larger
CORNERS = 73  # of the polygon that represents a region


def poles_chart(result: Identification, title: str = "Poles of plant and closed loop") -> Chart:
    """Poles in the z plane, all of them and those near z = 1, with 99 % regions where the uncertainty is known.

    Parameters
    ----------
    result : Identification
        From `identify`.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    model = result.model
    plant = model.poles()
    unstable = np.abs(plant) > 1.0
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    items: list[Item] = [Curve(np.cos(angle), np.sin(angle), "unit circle", REFERENCE)]
    items += _regions(result)
    items.append(_points(plant[~unstable], "plant", BLUE, model.sample_time))
    items.append(_points(plant[unstable], "plant, unstable", VERMILION, model.sample_time))
    if result.closed_loop_poles is not None:
        loop = result.closed_loop_poles
        hover = tuple(_text(pole, model.sample_time) for pole in loop)
        items.append(Points(loop.real, loop.imag, "closed loop", GREEN, "square", filled=False, hover=hover))
    panels = (
        Panel(
            Axis("real part (-)", limits=(-1.25, 1.25)),
            Axis("imaginary part (-)", limits=(-1.25, 1.25)),
            tuple(items),
            equal=True,
        ),
        Panel(
            Axis("real part (-)", limits=(1.0 - 2.0 * DETAIL, 1.0 + 0.5 * DETAIL)),
            Axis("imaginary part (-)", limits=(-1.25 * DETAIL, 1.25 * DETAIL)),
            tuple(items),
            "near z = 1",
            equal=True,
        ),
    )
    alt = (
        f"Poles of the plant and of its closed loop in the z plane: the model of order {model.order} has "
        f"{unstable.sum()} poles outside the unit circle"
        + ("." if result.closed_loop_poles is None else f"; the closed loop is {_loop(result)}.")
    )
    rows = [("plant", *_numbers(pole, model.sample_time)) for pole in plant]
    rows += [("closed loop", *_numbers(pole, model.sample_time)) for pole in _loop_poles(result)]
    table = Table(("of", "pole z", "magnitude", "frequency (Hz)"), tuple(rows))
    return Chart(title, alt, panels, columns=2, size=(11.0, 5.6), table=table)


def _regions(result: Identification) -> list[Item]:
    """Outlines of the ellipses in which the true poles lie at the level, by their normal distribution."""
    if result.uncertainty is None:
        return []
    radius = math.sqrt(-2.0 * math.log(1.0 - LEVEL))  # of two normal variables together
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS)
    circle = radius * np.array([np.cos(angle), np.sin(angle)])
    x, y = [], []
    for pole, covariance in zip(result.model.poles(), result.uncertainty.pole_covariance, strict=True):
        values, vectors = np.linalg.eigh(covariance)
        outline = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, np.newaxis] * circle)
        x.append(np.append(pole.real + outline[0], np.nan))
        y.append(np.append(pole.imag + outline[1], np.nan))
    return [Curve(np.concatenate(x), np.concatenate(y), f"plant, {100 * LEVEL:g} % region", Stroke(BLUE, width=0.8))]


def _points(poles: NDArray[np.complex128], label: str, colour: str, sample_time: float) -> Points:
    hover = tuple(_text(pole, sample_time) for pole in poles)
    return Points(poles.real, poles.imag, label, colour, "cross", hover=hover)


def _text(pole: complex, sample_time: float) -> str:
    number, magnitude, frequency = _numbers(pole, sample_time)
    return f"z = {number}, magnitude {magnitude}, {frequency} Hz"


def _numbers(pole: complex, sample_time: float) -> tuple[str, str, str]:
    number = f"{pole.real:.6g}" if pole.imag == 0.0 else f"{pole.real:.6g} {pole.imag:+.6g}j"
    natural = abs(np.log(pole)) / (2.0 * np.pi * sample_time) if pole != 0.0 else np.inf
    return number, f"{abs(pole):.6g}", f"{natural:.4g}"


def _loop(result: Identification) -> str:
    return "stable" if result.stable else "unstable"


def _loop_poles(result: Identification) -> NDArray[np.complex128]:
    return np.empty(0, dtype=np.complex128) if result.closed_loop_poles is None else result.closed_loop_poles
