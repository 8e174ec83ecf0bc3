"""Entries of Bode diagrams of p x m responses: faint cross terms are faded, and users choose what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import FrequencyResponse
from amb_core.loop.records import LoopRecord
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.comparison import comparison_chart
from amb_core.report.figures.drawing import Band, Curve
from amb_core.report.figures.entries import entries_from, faint_entries
from amb_core.report.figures.style import FADED

FREQUENCY = np.geomspace(1.0, 1_000.0, 60)
AXES = ("x_a", "y_a", "x_b", "y_b")
INPUTS = tuple(f"i_{name}" for name in AXES)
SMALL = ("i_x_a", "y_a")  # the entry that is 0.5 % of the others


def response(label: str = "model", **settings: object) -> FrequencyResponse:
    """Four axes, the bearings coupled along x and along y; from x_a to y_a there is 0.5 %."""
    matrix = np.eye(4) + 0.3 * np.eye(4, k=2) + 0.3 * np.eye(4, k=-2)
    matrix[1, 0] = 0.005
    values = 1e-4 / (1.0 + (FREQUENCY / 50.0) ** 2)[:, np.newaxis, np.newaxis] * matrix
    names = (INPUTS, AXES, ("A",) * 4, ("m",) * 4)
    keys = ("input_names", "output_names", "input_units", "output_units")
    return FrequencyResponse(FREQUENCY, values, label, **dict(zip(keys, names, strict=True)), **settings)


def measured(deviation: float = 2e-7, coherence: float = 0.95) -> FrequencyResponse:
    shape = (60, 4, 4)
    spread = deviation * np.ones(shape) / (1.0 + (FREQUENCY / 50.0) ** 2)[:, np.newaxis, np.newaxis]
    return response(
        "measured", magnitude_deviation=spread, phase_deviation=np.full(shape, 0.01),
        coherence=np.full((60, 4), coherence),
    )  # fmt: skip


def faint(responses: list[FrequencyResponse]) -> set[tuple[str, str]]:
    return {(INPUTS[place], AXES[output]) for output, place in np.argwhere(faint_entries(responses)[0])}


def test_cross_terms_of_models_below_one_percent_are_faint() -> None:
    zeros = {(i, y) for i in INPUTS for y in AXES if i[2] != y[0]}
    assert faint([response()]) == zeros and SMALL in zeros
    assert faint_entries([response()])[1] == "faded: below 1 % of the largest singular value at most frequencies"
    assert faint([replace(response(), response=np.ones((60, 4, 4)))]) == set()
    assert faint_entries([replace(response(), response=np.ones((60, 4, 4)))])[1] == ""


def test_the_coherence_of_a_measured_response_decides_where_there_is_one() -> None:
    assert SMALL not in faint([measured(), response()])  # half a percent, but measured three times as accurately
    assert SMALL in faint([measured(deviation=1e-6), response()])
    # With an output of low coherence all its cross terms are faint, the diagonal never.
    low = faint([measured(coherence=0.3), response()])
    assert len(low) == 12 and ("i_x_a", "x_a") not in low
    assert faint_entries([measured(), response()])[1] == "faded: coherence below 0.5 at most frequencies"


def test_a_process_of_more_outputs_than_inputs_has_no_diagonal() -> None:
    part = response()
    tall = FrequencyResponse(
        FREQUENCY, part.response[:, :, :2], "tall", input_names=INPUTS[:2], output_names=AXES,
        input_units=("A",) * 2, output_units=("m",) * 4,
    )  # fmt: skip
    assert faint_entries([tall])[0].sum() == 4


def test_faint_entries_are_faded_in_figure_and_page_and_the_legend_says_so() -> None:
    chart = bode_chart([measured(1e-6), response()])
    by_title = {panel.title: panel for panel in chart.panels if panel.title}
    strong, weak = by_title["i_x_a to x_a"], by_title["i_x_a to y_a"]
    assert {item.stroke.opacity for item in strong.items if isinstance(item, Curve)} == {1.0}
    assert {item.stroke.opacity for item in weak.items if isinstance(item, Curve)} == {FADED}
    assert {item.opacity for item in weak.items if isinstance(item, Band)} == {FADED}
    reason = "faded: coherence below 0.5 at most frequencies"
    assert reason in [item.label for item in weak.items if isinstance(item, Curve)]
    assert f"{reason[0].upper()}{reason[1:]}: " in chart.alt and "i_x_a to y_a" in chart.alt
    figure = chart.figure()
    assert reason in [text.get_text() for text in figure.legends[0].get_texts()]
    lines = {line.get_alpha() for axes in figure.axes for line in axes.lines}
    assert lines == {None, FADED}
    page = chart.page()
    assert isinstance(page, go.Figure)
    assert {trace.opacity for trace in page.data} == {None, FADED}
    assert [trace.showlegend for trace in page.data if trace.name == reason].count(True) == 1


def test_users_choose_the_entries() -> None:
    chosen = entries_from("i_x_a:x_a, i_x_b:x_a", INPUTS, AXES)
    chart = bode_chart([response()], entries=chosen)
    assert [panel.title for panel in chart.panels] == ["i_x_a to x_a", "i_x_b to x_a", "", ""]
    diagonal = bode_chart([measured()], entries=entries_from("diagonal", INPUTS, AXES))
    assert diagonal.columns == 4 and len(diagonal.panels) == 12
    assert entries_from("", INPUTS, AXES) is None
    three = bode_chart([measured()], entries=chosen and [*chosen, ("i_y_a", "y_a")])
    assert three.columns == 3 and [panel.y.label for panel in three.panels][6:] == [
        "coherence of x_a",
        "coherence of y_a",
    ]


@pytest.mark.parametrize("text", ["i_x:x", "i_x_a", "x_a:i_x_a", "i_x_a:x_a,,"])
def test_unknown_entries_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(
        IdentificationError, match=r"^entry '.*' is not allowed; allowed: diagonal, or input:output with "
    ):
        entries_from(text, INPUTS, AXES)
    with pytest.raises(IdentificationError, match=r"^entries i_x:x cannot be drawn; there are the inputs i_x_a, i_y_a"):
        bode_chart([response()], entries=[("i_x", "x")])


@pytest.mark.parametrize("axes", [1, 4])
def test_models_are_compared_with_the_data_on_every_axis(axes: int) -> None:
    samples = np.random.default_rng(0).normal(size=(50, axes))
    record = LoopRecord(0, 1e-4, samples, samples, samples)
    chart = comparison_chart(record, {"model": record})
    assert len(chart.panels) == 2 * axes and f"100.0 % on {record.axes[-1]}" in chart.alt
