"""Bode diagram: panels, units, bands, phases, and the same in figure and page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import FrequencyResponse
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.drawing import Band, Curve, Panel

FREQUENCY = np.concatenate([[0.0], np.geomspace(1.0, 1_000.0, 50)])
SHAPE = (51, 2, 2)


def plant(label: str, scale: float = 1.0, **settings: object) -> FrequencyResponse:
    """A mass on a negative stiffness, -180 degrees at all frequencies."""
    response = -scale * 1e-4 / (1.0 + (FREQUENCY / 50.0) ** 2)
    return FrequencyResponse(FREQUENCY, response[:, np.newaxis, np.newaxis] * np.ones(SHAPE), label, **settings)


@pytest.fixture(scope="module")
def responses() -> list[FrequencyResponse]:
    model = plant("model", magnitude_deviation=np.full(SHAPE, 1e-7), phase_deviation=np.full(SHAPE, 0.01))
    return [plant("measured", 1.1, coherence=np.full((51, 2), 0.9)), model]


def of_kind(panel: Panel, kind: type) -> list:
    return [item for item in panel.items if isinstance(item, kind)]


def test_there_are_magnitude_and_phase_of_each_entry_and_the_coherence_of_each_output(responses) -> None:
    chart = bode_chart(responses)
    labels = [panel.y.label for panel in chart.panels]
    rows = ["magnitude (µm/A)", "magnitude (µm/A)", "phase (°)", "phase (°)"]
    assert labels == [*rows, *rows, "coherence of x", "coherence of y"]
    titles = [panel.title for panel in chart.panels if panel.title]
    assert titles == ["i_x to x", "i_y to x", "i_x to y", "i_y to y"]
    assert len(bode_chart(responses[1:]).panels) == 8
    assert chart.columns == 2


def test_magnitudes_are_in_um_over_a_with_their_band(responses) -> None:
    panel = bode_chart(responses).panels[0]
    curve = next(curve for curve in of_kind(panel, Curve) if curve.label == "model")
    assert curve.x[0] == pytest.approx(1.0)  # zero frequency has no place
    assert curve.y[0] == pytest.approx(100.0, rel=1e-3)
    (band,) = of_kind(panel, Band)
    assert band.label == "model: 99 % band"
    assert band.high[0] == pytest.approx(100.0 + 2.576 * 0.1, rel=1e-3)
    assert isinstance(panel.items[0], Band)  # under the curves


def test_phases_of_minus_180_degrees_are_not_split_by_noise(responses) -> None:
    noisy = np.array(responses[0].response)
    noisy[::3] *= np.exp(3.0j)
    chart = bode_chart([replace(responses[0], response=noisy), responses[1]])
    measured, model = of_kind(chart.panels[2], Curve)
    assert model.y == pytest.approx(-180.0)
    assert np.all(np.abs(measured.y - model.y) <= 180.0)


def test_phases_are_wrapped_without_a_line_across_the_diagram(responses) -> None:
    turned = np.array(responses[1].response) * np.exp(-1j * np.linspace(0.0, 20.0, SHAPE[0]))[:, None, None]
    deviation = np.full(SHAPE, 0.01)
    chart = bode_chart([replace(responses[1], response=turned, phase_deviation=deviation)])
    panel = chart.panels[2]
    (curve,) = of_kind(panel, Curve)
    assert panel.y.limits == (-270.0, 90.0)
    assert np.nanmin(curve.y) >= -270.0 and np.nanmax(curve.y) <= 90.0
    steps = np.diff(curve.y)
    assert np.nanmax(np.abs(steps)) < 180.0 and np.isnan(steps).any()
    assert all(band.low.min() >= -270.0 and band.high.max() <= 90.0 for band in of_kind(panel, Band))


def test_what_cannot_be_drawn_together_is_refused(responses) -> None:
    with pytest.raises(IdentificationError, match="at least one frequency response"):
        bode_chart([])
    with pytest.raises(IdentificationError, match="different labels, not model, model"):
        bode_chart([responses[1], responses[1]])
    with pytest.raises(IdentificationError, match="the same input units; there are A, A and V, V"):
        bode_chart([responses[0], replace(responses[1], input_units=("V", "V"))])


def test_a_response_of_zero_is_drawn(responses) -> None:
    nothing = replace(responses[0], response=np.zeros(SHAPE))
    limits = bode_chart([nothing]).panels[0].y.limits
    assert limits is not None
    assert 0.0 < limits[0] < limits[1]
    bode_chart([nothing]).figure()


def test_alt_text_and_table_tell_the_main_numbers(responses) -> None:
    chart = bode_chart(responses)
    assert "1 to 1000 Hz, of: measured; model" in chart.alt
    assert "bands of model" in chart.alt
    assert chart.table is not None
    row = next(row for row in chart.table.rows if row[:2] == ("model", "i_x to x"))
    assert row[2:4] == ("1", "99.96 µm/A")
    assert row[4] == "99.7 to 100"


def test_figure_and_page_show_the_same(responses) -> None:
    figure, page = bode_chart(responses).figure(), bode_chart(responses).page()
    assert len(figure.axes) == 10
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert legend == {"measured", "model", "model: 99 % band"}
    assert legend == {trace.name for trace in page.data if trace.showlegend}
