"""Fit of the predictions over how many steps ahead they look, of one or more models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from amb_core.identification.fit import fit_text
from amb_core.identification.validation import Prediction
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Points, Table
from amb_core.report.figures.style import MODELS, Marker

MARKERS: tuple[Marker, ...] = ("circle", "square", "diamond", "triangle")
LOWEST = -20.0  # percent, below which a curve leaves the figure


def prediction_chart(
    predictions: Mapping[str, Prediction],
    sample_time: float,
    output_names: Sequence[str] = ("x", "y"),
    title: str = "Prediction from the filtered state",
) -> Chart:
    """NRMSE fit over the prediction horizon, a panel for each output.

    Parameters
    ----------
    predictions : mapping of str to Prediction
        Predictions of the same data by models, by name.
    sample_time : float
        Sample time (s).
    output_names : sequence of str, optional
        Names of the outputs.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    panels = []
    for column, name in enumerate(output_names):
        items: list[Curve | Points] = []
        lowest = 100.0
        for number, (label, prediction) in enumerate(predictions.items()):
            stroke, marker = MODELS[number % len(MODELS)], MARKERS[number % len(MARKERS)]
            time, fit = 1e3 * sample_time * prediction.horizons, prediction.fit[:, column]
            hover = tuple(
                f"{label}: {horizon} steps, {fit_text(fit[index])}" for index, horizon in enumerate(prediction.horizons)
            )
            items.append(Curve(time, fit, "", stroke))
            items.append(Points(time, fit, label, stroke.colour, marker, hover=hover))
            lowest = min(lowest, float(fit.min()))
        margin = 0.05 * (100.0 - max(lowest, LOWEST)) + 1e-3
        ends = (max(lowest, LOWEST) - margin, 100.0 + margin)
        longest = max(float(prediction.horizons[-1]) for prediction in predictions.values())
        span = (0.9e3 * sample_time, 1.1e3 * sample_time * longest)
        panels.append(
            Panel(Axis("horizon (ms)", log=True, limits=span), Axis("fit (%)", limits=ends), tuple(items), name)
        )
    sentences = []
    for label, prediction in predictions.items():
        last = zip(output_names, prediction.fit[-1], strict=True)
        fits = ", ".join(f"{name} {fit_text(fit)}" for name, fit in last)
        sentences.append(f"{label}: {fits} at {prediction.horizons[-1]} steps")
    rows = tuple(
        (label, str(horizon), *(f"{value:.2f}" for value in fit))
        for label, prediction in predictions.items()
        for horizon, fit in zip(prediction.horizons, prediction.fit, strict=True)
    )
    table = Table(("model", "steps", *(f"fit {name} (%)" for name in output_names)), rows)
    alt = f"Fit of predictions over the horizon. {'; '.join(sentences)}."
    columns = len(output_names)
    return Chart(title, alt, tuple(panels), columns, size=(4.6 * max(columns, 2), 4.6), table=table)
