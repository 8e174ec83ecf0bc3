"""Sensitivity over frequency with its bound and its measurement, and the structured singular value."""

from __future__ import annotations

import numpy as np

from amb_core.linear import Arrays
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Band, Curve, Item, Panel, Points, Rule, Span, Table
from amb_core.report.figures.style import BLUE, GREY, ORANGE, VERMILION, Stroke
from amb_core.robustness.assessment import Assessment
from amb_core.robustness.measured import MeasuredSensitivity

FREQUENCY = Axis("frequency (Hz)", log=True)
ROOM = 1.25  # of the ends of an axis beyond the values
HIGHEST = 1e3  # of a bound that is drawn
POINTS = 40  # of a measurement that are drawn, at most


def sensitivity_chart(
    assessment: Assessment, measured: MeasuredSensitivity | None = None, title: str = "Sensitivity"
) -> Chart:
    """|S| of each axis, its largest value over the ellipsoid of the model, limits of zones, and the measured one."""
    settings, frequency = assessment.settings, assessment.frequency
    response = assessment.feedback.output_sensitivity.response(frequency)
    panels = []
    for number, axis in enumerate(assessment.axes):
        size = np.abs(response[:, number, number])
        items: list[Item] = []
        if assessment.bounds is not None:
            known = assessment.bounds.frequency
            of_model = np.interp(known, frequency, size)
            bound = np.minimum(np.maximum(assessment.bounds.axes[number].sensitivity.curve, of_model), HIGHEST)
            items.append(Band(known, of_model, bound, f"up to {100.0 * settings.confidence:g} %", BLUE))
            items += _unknown(frequency, known)
        items.append(Curve(frequency, size, "model", Stroke(BLUE)))
        if measured is not None:
            some = slice(None, None, -(-len(measured.frequency) // POINTS))  # so that the model stays visible
            values, error = np.abs(measured.own[some, number]), 2.58 * measured.deviation[some, number]
            at = measured.frequency[some]
            items.append(Band(at, np.maximum(values - error, 1e-6), values + error, "measured, 99 %", VERMILION))
            items.append(Points(at, values, "measured", VERMILION, "circle"))
        items += [
            Curve(frequency[[0, -1]], np.full(2, limit), f"end of zone {zone}", Stroke(GREY, "dot", 0.9))
            for zone, limit in zip("ABC", settings.sensitivity_limits, strict=True)
        ]
        up = Axis("|S| (-)", log=True, limits=(size.min() / ROOM, ROOM * max(size.max(), *settings.sensitivity_limits)))
        panels.append(Panel(FREQUENCY, up, tuple(items), f"axis {axis.name}"))
    rows = tuple(
        (axis.name, f"{axis.sensitivity.value:.4f}", f"{axis.sensitivity.frequency:.4g}", axis.zone)
        for axis in assessment.axes
    )
    alt = "Sensitivity over frequency. " + " ".join(
        f"Axis {name}: peak {value} at {at} Hz, zone {zone}." for name, value, at, zone in rows
    )
    table = Table(("axis", "peak of |S|", "frequency (Hz)", "zone after ISO 14839-3"), rows)
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 1.0 + 2.4 * len(panels)), table=table)


def _unknown(frequency: Arrays, known: Arrays) -> list[Item]:
    """Hatching where nothing is stated."""
    sides = ((frequency[0], known[0]), (known[-1], frequency[-1]))
    return [Span(low, high, "no statement", GREY, "/") for low, high in sides if high > low]


def mu_chart(assessment: Assessment, title: str = "Structured singular value") -> Chart:
    """Upper bound of mu over frequency, and the worst case that was replayed."""
    mu = assessment.mu
    items: list[Item] = [
        Curve(mu.grid, mu.upper_curve, "upper bound", Stroke(BLUE)),
        Curve(mu.grid[[0, -1]], np.ones(2), "1: the assumed perturbations", Stroke(GREY, "dot", 0.9)),
        Rule(mu.frequency, "largest", Stroke(ORANGE, "dash", 0.9)),
    ]
    if len(mu.perturbation):
        at, value = np.array([mu.lower_frequency]), np.array([mu.lower])
        items.append(Points(at, value, "worst case, replayed", VERMILION, "circle"))
    rows = tuple(
        (block.name, "real" if block.real else "complex", f"{abs(value):.4f}", f"{np.degrees(np.angle(value)):.1f}")
        for block, value in zip(assessment.uncertain.blocks, mu.perturbation, strict=False)
    )
    alt = (
        f"Upper bound of the structured singular value over frequency: at most {mu.upper:.4f} at "
        f"{mu.frequency:.4g} Hz. "
        f"A perturbation of {1.0 / mu.lower:.3g} times the assumed size makes the loop oscillate at "
        f"{mu.lower_frequency:.4g} Hz."
        if mu.lower
        else f"Upper bound of the structured singular value: at most {mu.upper:.4f}; no worst case was found."
    )
    table = Table(("perturbation", "kind", "share of 1", "angle (degree)"), rows)
    drawn = mu.upper_curve[mu.upper_curve > 0.0]
    ends = (min(drawn.min(), 1.0) / ROOM, ROOM * max(drawn.max(), 1.0)) if drawn.size else None
    up = Axis("mu (-)", log=True, limits=ends)
    return Chart(title, alt, (Panel(FREQUENCY, up, tuple(items)),), size=(8.0, 4.5), table=table)
