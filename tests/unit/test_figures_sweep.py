"""Response to a sweep: regions where the classifier has them, in figure and page alike, and few points of many."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import RegionError
from amb_core.loop.records import LoopRecord
from amb_core.regions import AxisState, Classification, Judged, Onset, Region, RegionState
from amb_core.report.figures.drawing import Curve, Panel, Rule, Span
from amb_core.report.figures.sweep import sweep_chart
from amb_core.report.figures.thinning import extremes, thinned_path

ALL_JUDGED = Judged({}, {}, 0.7)
STEPS, RATE = 20_000, 10_000.0
START = 2_000  # of the sweep
DRIFT, END = Onset(8_000, 0.8, 400.0, False), Onset(STEPS, 2.0, 1_000.0, False)


@pytest.fixture(scope="module")
def frequency() -> np.ndarray:
    """100 Hz at the start of the sweep, 50 Hz more each 0.1 s; none before it."""
    values = np.full(STEPS, np.nan)
    values[START:] = 100.0 + 0.05 * np.arange(STEPS - START)
    return values


@pytest.fixture(scope="module")
def record(frequency: np.ndarray) -> LoopRecord:
    sweep = 20e-6 * np.sin(2.0 * np.pi * np.cumsum(np.nan_to_num(frequency)) / RATE)
    position = np.column_stack([np.zeros(STEPS), sweep - 66e-6])
    return LoopRecord(0, 1.0 / RATE, np.column_stack([np.zeros(STEPS), sweep]), position, np.zeros((STEPS, 2)))


@pytest.fixture(scope="module")
def classification() -> Classification:
    linear = Onset(0, 0.0, math.nan, False)
    states = []
    for stop in range(100, STEPS + 1, 100):
        region, since = (Region.B, DRIFT) if stop > 9_000 else (Region.A, linear)
        axis = AxisState(region, since, *[0.0] * 8, sampling_beat=15_000 < stop <= 15_500)
        states.append(RegionState(stop - 1, (axis, axis), (), region, since, 0.0, stop > 500))
    last = replace(states[-1], region=Region.D, since=END)
    return Classification(
        [*states, last], {Region.B: DRIFT, Region.D: END}, {"x": {}, "y": {Region.B: DRIFT}}, ALL_JUDGED
    )


def of_kind(panel: Panel, kind: type) -> list:
    return [item for item in panel.items if isinstance(item, kind)]


def test_regions_begin_at_their_onsets_over_time(record, classification) -> None:
    (panel,) = sweep_chart(record, classification).panels
    spans = [(span.letter, span.start, span.stop) for span in of_kind(panel, Span)]
    assert spans == [("A", 0.0, pytest.approx(0.8)), ("B", pytest.approx(0.8), pytest.approx(1.9999))]
    assert [rule.x for rule in of_kind(panel, Rule)] == pytest.approx([0.8, 1.9999])


def test_no_region_is_said_of_what_was_never_classified(record, classification) -> None:
    in_a = replace(classification, onsets={}, axis_onsets={})
    linear = [state for state in classification.states if state.region is Region.A]
    assert "It stays in region A" in sweep_chart(record, replace(in_a, states=linear)).alt
    unsettled = [replace(state, settled=False) for state in linear]
    assert "It is too short for regions B and C." in sweep_chart(record, replace(in_a, states=unsettled)).alt


def test_regions_begin_at_their_input_frequency_over_frequency(record, classification, frequency) -> None:
    (panel,) = sweep_chart(record, classification, frequency, over="frequency").panels
    assert panel.x.label == "input frequency (Hz)"
    assert panel.x.limits == pytest.approx((100.0, 999.95))
    assert [rule.x for rule in of_kind(panel, Rule)] == pytest.approx([400.0, 999.95])
    assert "400 Hz" in of_kind(panel, Rule)[0].label
    assert all(np.all(np.diff(curve.x) >= 0) for curve in of_kind(panel, Curve))


def test_only_excited_axes_are_drawn_unless_others_are_asked_for(record, classification) -> None:
    assert [panel.y.label for panel in sweep_chart(record, classification).panels] == ["y (µm)"]
    assert [panel.y.label for panel in sweep_chart(record, classification, axes="xy").panels] == ["x (µm)", "y (µm)"]


def test_the_model_is_drawn_at_its_own_steps(record, classification) -> None:
    part = record.window(5_000, 4_000)
    model = replace(part, position=part.position + 1e-6)
    (panel,) = sweep_chart(record, classification, model=model).panels
    drawn = next(curve for curve in of_kind(panel, Curve) if curve.label == "model")
    there = np.isfinite(drawn.y)
    assert drawn.x[there].min() == pytest.approx(0.5)
    assert drawn.x[there].max() == pytest.approx(0.8999)
    plant = np.interp(drawn.x[there], record.time, 1e6 * record.position[:, 1])
    assert drawn.y[there] == pytest.approx(plant + 1.0)


def test_beating_with_the_sample_rate_is_marked_where_it_was(record, classification) -> None:
    (panel,) = sweep_chart(record, classification).panels
    (bar,) = [curve for curve in of_kind(panel, Curve) if "beats" in curve.label]
    assert bar.x[np.isfinite(bar.y)] == pytest.approx([1.5099, 1.5199, 1.5299, 1.5399, 1.5499])


def test_the_mean_is_drawn_for_a_sweep_alone(record, classification, frequency) -> None:
    def labels(*known: np.ndarray) -> list[str]:
        return [curve.label for curve in of_kind(sweep_chart(record, classification, *known).panels[0], Curve)]

    assert "mean position over 0.1 s" in labels(frequency)
    assert "mean position over 0.1 s" not in labels()


def test_gaps_stay_gaps(record, classification) -> None:
    position = record.position.copy()
    position[10_000:12_000] = np.nan
    (panel,) = sweep_chart(replace(record, position=position), classification).panels
    curve = of_kind(panel, Curve)[0]
    assert not np.isfinite(curve.y[(curve.x > 1.001) & (curve.x < 1.199)]).any()


def test_it_is_told_when_there_is_no_rising_frequency(record, classification, frequency) -> None:
    falling = frequency[::-1]
    for wrong in (None, falling, frequency[:-1], np.full(STEPS, np.nan)):
        with pytest.raises(RegionError, match="frequency of each sample is known and rises"):
            sweep_chart(record, classification, wrong, over="frequency")


def test_alt_text_and_table_name_the_onsets(record, classification) -> None:
    chart = sweep_chart(record, classification)
    assert "B (drifting bias) begins at 400 Hz, 0.80 s" in chart.alt
    assert chart.table is not None
    assert ("y", "B drifting bias", "0.800", "400.0") in chart.table.rows


def test_the_alt_text_has_the_motion_of_what_is_drawn(record, classification, frequency) -> None:
    assert "moves up to 0 µm" in sweep_chart(record, classification, axes="x").alt
    late = replace(record, position=np.where(np.arange(STEPS)[:, np.newaxis] < START, 1e-3, record.position))
    swept = sweep_chart(late, classification, frequency, over="frequency").alt
    assert "from 0.2 s to 2.0 s" in swept and "moves up to 86 µm" in swept


def test_figure_and_page_show_the_same(record, classification) -> None:
    figure = sweep_chart(record, classification, axes="xy").figure()
    page = sweep_chart(record, classification, axes="xy").page()
    assert len(figure.axes) == 2
    assert (page.layout.yaxis.title.text, page.layout.yaxis2.title.text) == ("x (µm)", "y (µm)")
    legend = {text.get_text() for text in figure.legends[0].get_texts()}
    assert legend == {trace.name for trace in page.data if trace.showlegend}
    rectangles = [shape for shape in page.layout.shapes if shape.type == "rect"]
    assert [shape.x0 for shape in rectangles] == pytest.approx([0.0, 0.8, 0.0, 0.8])


def test_a_long_record_is_drawn_by_its_extremes() -> None:
    x = np.arange(1e6)
    y = np.sin(x)
    y[654_321], y[123_456] = 7.0, np.nan
    short_x, short_y = extremes(x, y)
    assert len(short_x) <= 4 * 1200
    assert np.all(np.diff(short_x) > 0)
    assert short_y[short_x == 654_321] == [7.0]
    assert np.nanmin(short_y) == pytest.approx(-1.0, abs=1e-3)
    assert (short_x[0], short_x[-1]) == (0, 999_999)


def test_a_path_keeps_what_can_be_seen() -> None:
    rest = np.full((1000, 2), 0.5)
    path = np.vstack([rest, [[1.0, 0.5]], rest])
    assert thinned_path(path, 0.1).tolist() == [[0.5, 0.5], [1.0, 0.5], [0.5, 0.5], [0.5, 0.5]]


def test_a_path_with_gaps_keeps_what_lies_between_them() -> None:
    gap = np.full((5, 2), np.nan)
    path = np.vstack([gap, [[0.0, 0.0], [1.0, 0.0]], gap, [[2.0, 0.0]], gap])
    assert thinned_path(path, 0.1)[:, 0] == pytest.approx([0.0, 1.0, np.nan, 2.0], nan_ok=True)
    assert thinned_path(gap, 0.1).shape == (1, 2)
