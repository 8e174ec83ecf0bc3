"""Figures of validations: what the charts hold; drawing itself is tested with the commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.identification.validation import Prediction, check_residuals
from amb_core.report.figures.comparison import comparison_chart, title_of_longest
from amb_core.report.figures.drawing import Band, Curve, Points, Span
from amb_core.report.figures.prediction import prediction_chart
from amb_core.report.figures.residuals import residuals_chart


def labels(items) -> set[str]:
    return {item.label for item in items}


def test_residuals_outside_of_the_band_are_marked() -> None:
    random = np.random.default_rng(0)
    u = random.normal(size=(4_000, 2))
    e = random.normal(size=(4_000, 2))
    e[2:, 0] += 0.3 * u[:-2, 1]
    tests = check_residuals([e], [u])
    chart = residuals_chart(tests)
    assert len(chart.panels) == 2 + 4 and chart.columns == 2
    x_by_i_y = chart.panels[4]
    outside = next(item for item in x_by_i_y.items if isinstance(item, Points) and item.label == "outside of the band")
    assert 2 in outside.x and outside.y[list(outside.x).index(2)] == pytest.approx(0.3, abs=0.05)
    band = next(item for item in x_by_i_y.items if isinstance(item, Band))
    assert band.high[0] == pytest.approx(2.576 / np.sqrt(4_000), rel=1e-3)
    feedback = next(item for item in x_by_i_y.items if isinstance(item, Span))
    assert feedback.stop == 0.5  # lag 0 is the answer of the controller to the residual
    assert "not independent" in chart.alt and "At 99.9 % they are" in chart.alt
    assert chart.table is not None and chart.table.header[-1] == "explained variance"


def test_each_prediction_has_its_curve_over_the_horizon() -> None:
    fit = np.array([[99.0, 98.0], [90.0, 50.0]])
    one = Prediction(np.array([1, 100]), fit, (np.zeros((2, 2)),), np.zeros((1, 2)))
    other = replace(one, fit=fit - 200.0)
    chart = prediction_chart({"good": one, "bad": other}, 1e-4)
    x = chart.panels[0]
    assert labels(item for item in x.items if isinstance(item, Points)) == {"good", "bad"}
    good = next(item for item in x.items if isinstance(item, Curve))
    assert good.x == pytest.approx([0.1, 10.0]) and good.y.tolist() == [99.0, 90.0]
    assert x.y.limits is not None and x.y.limits[0] > -30.0  # a bad model does not flatten the good one


def test_the_comparison_shows_measured_and_models_and_their_errors(bearing) -> None:
    measured = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    shifted = replace(measured, position=measured.position + 1e-6)
    chart = comparison_chart(measured, {"one": measured, "two": shifted}, without_error=("one",))
    response, error = chart.panels[:2]
    assert labels(response.items) == {"reference", "measured", "one", "two"}
    assert labels(error.items) == {"two"}
    assert isinstance(error.items[0], Curve) and error.items[0].y == pytest.approx(-1.0)
    assert "one fits to 100.0 % on x" in chart.alt


def test_a_figure_of_one_of_several_parts_names_it(bearing) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    first = record.first_step
    parts = (record.window(first, 100), record.window(first + 200, 300))
    title = title_of_longest("Response", parts)
    assert title == f"Response, the longest of 2 parts (steps {first + 200} to {first + 499}); fits are of this part"
    assert title_of_longest("Response", parts[:1]) == "Response"
