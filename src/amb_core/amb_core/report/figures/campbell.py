"""Campbell diagram: frequencies of the modes of the loop over the running speed, identified ones over computed ones."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.model.modes import Mode, Modes
from amb_core.plant.campbell import Branch, Campbell, CriticalSpeed
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Item, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, GREY, PURPLE, REFERENCE, VERMILION, Marker, Stroke

RPM = 60.0
WHIRLS: dict[str, tuple[Stroke, Marker]] = {
    "forward": (Stroke(BLUE, width=1.6), "triangle"),
    "backward": (Stroke(VERMILION, "dash", 1.6), "square"),
    "planar": (Stroke(GREEN, "dashdot", 1.4), "circle"),
    "mixed": (Stroke(PURPLE, "dot", 1.6), "diamond"),
    "none": (Stroke(GREY, "dot", 1.0), "circle"),
}
OPEN = Stroke(GREY, "dot", 1.2)


def campbell_chart(
    diagram: Campbell,
    identified: Iterable[tuple[float, Modes]] = (),
    title: str = "Campbell diagram",
) -> Chart:
    """Damped natural frequencies over the running speed, by whirl direction, with the 1x line and critical speeds.

    Parameters
    ----------
    diagram : Campbell
        Computed modes.
    identified : iterable of (float, Modes), optional
        Running speeds (Hz) with the modes of the loop of an identified model, drawn as points.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    critical = diagram.critical_speeds
    items: list[Item] = [
        Curve(RPM * branch.speed, branch.damped_hz, "bending without loop" if number == 0 else "", OPEN)
        for number, branch in enumerate(diagram.open_branches)
    ]
    items += _computed(diagram.branches)
    fastest = float(diagram.speed[-1])
    items.append(Curve(RPM * diagram.speed, diagram.speed, "running speed (1x)", REFERENCE))
    items += _identified(identified)
    if critical:
        places = np.array([item.speed for item in critical])
        hover = tuple(_text(item) for item in critical)
        items.append(Points(RPM * places, places, "critical speed", GREY, "diamond", filled=False, hover=hover))
    highest = max([fastest, *(float(branch.damped_hz.max()) for branch in diagram.branches)])
    panel = Panel(
        Axis("running speed (rpm)", limits=(RPM * float(diagram.speed[0]), RPM * max(fastest, 1e-3))),
        Axis("damped natural frequency (Hz)", limits=(0.0, 1.08 * highest)),
        tuple(items),
    )
    rows = tuple(
        (f"{item.rpm:.0f}", item.kind or "-", item.whirl, f"{item.damping_ratio:.3f}", f"{item.amplification:.3g}")
        for item in critical
    )
    table = Table(("critical speed (rpm)", "mode", "whirl", "damping ratio", "amplification"), rows)
    alt = (
        f"Damped natural frequencies of {len(diagram.branches)} modes of the closed loop over the running speed, up to "
        f"{RPM * fastest:.0f} rpm; " + " ".join([_listed(critical), *(f"{remark}." for remark in diagram.remarks)])
    )
    return Chart(title, alt, (panel,), size=(8.0, 5.6), table=table)


def _computed(branches: Iterable[Branch]) -> list[Item]:
    """A curve for each stretch of a branch with one direction of whirl; the first of each direction has the label."""
    items: list[Item] = []
    labelled: set[str] = set()
    for branch in branches:
        whirls = np.array([mode.whirl for mode in branch.modes])
        for whirl, (stroke, _) in WHIRLS.items():
            here = whirls == whirl
            if not here.any():
                continue
            here[:-1] |= here[1:]  # a stretch begins where the one before ends
            frequency = np.where(here, branch.damped_hz, np.nan)
            label = "" if whirl in labelled else f"{whirl} whirl" if whirl != "none" else "no orbit"
            labelled.add(whirl)
            items.append(
                Curve(RPM * branch.speed, frequency, label, stroke, tuple(_mode(mode) for mode in branch.modes))
            )
    return items


def _identified(identified: Iterable[tuple[float, Modes]]) -> list[Item]:
    by_whirl: dict[str, list[tuple[float, Mode]]] = {}
    for speed, modes in identified:
        for mode in modes.selected().modes:
            if mode.oscillates:
                by_whirl.setdefault(mode.whirl, []).append((speed, mode))
    items: list[Item] = []
    for whirl, points in by_whirl.items():
        stroke, marker = WHIRLS[whirl]
        speeds: NDArray[np.float64] = np.array([speed for speed, _ in points])
        frequency = np.array([mode.damped_hz for _, mode in points])
        hover = tuple(_mode(mode) for _, mode in points)
        items.append(Points(RPM * speeds, frequency, f"identified, {whirl}", stroke.colour, marker, hover=hover))
    return items


def _mode(mode: Mode) -> str:
    return f"{mode.kind or 'mode'}, {mode.damped_hz:.4g} Hz, damping ratio {mode.damping_ratio:.3g}, {mode.whirl}"


def _text(item: CriticalSpeed) -> str:
    damped = ", critically damped" if item.critically_damped else ""
    return f"{item.kind or 'mode'}, {item.whirl}, {item.rpm:.0f} rpm, damping ratio {item.damping_ratio:.3g}{damped}"


def _listed(critical: tuple[CriticalSpeed, ...]) -> str:
    if not critical:
        return "no mode has the frequency of the running speed."
    return "frequency and running speed are equal at " + "; ".join(_text(item) for item in critical) + "."
