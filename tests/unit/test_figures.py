"""Figures: axes in um and s, plant and model with fit, drawn without a display."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import AmbError
from amb_core.loop.records import LoopRecord
from amb_core.report.figures import orbit_chart, plot, response_chart
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.style import BLUE, Stroke


@pytest.fixture
def measured() -> LoopRecord:
    time = np.arange(500) * 1e-4
    position = 1e-6 * np.column_stack([50.0 * np.sin(300.0 * time), -66.0 + 10.0 * np.cos(300.0 * time)])
    return LoopRecord(1_000, 1e-4, np.zeros((500, 2)), position, np.zeros((500, 2)))


def test_the_orbit_is_in_um_with_plant_model_and_backup_bearing(measured: LoopRecord) -> None:
    chart = orbit_chart(measured, replace(measured, position=1.01 * measured.position), 250e-6)
    figure = chart.figure()
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (µm)", "y (µm)")
    assert chart.title in [text.get_text() for text in figure.texts]
    plant, model, bearing = axes.get_lines()
    assert np.array_equal(plant.get_xydata(), 1e6 * measured.position)
    assert "fit x" in model.get_label()
    assert np.hypot(*bearing.get_xydata().T) == pytest.approx(250.0)


@pytest.mark.filterwarnings("error")
def test_the_orbit_remains_where_samples_are_missing(measured: LoopRecord) -> None:
    position = measured.position.copy()
    position[200:250] = np.nan
    chart = orbit_chart(replace(measured, position=position))
    (plant,) = chart.panels[0].items
    assert isinstance(plant, Curve)
    assert np.isfinite(plant.x).sum() == 450 and np.isnan(plant.x).sum() == 1
    assert "it reaches 50 µm on x and 76 µm on y" in chart.alt


def test_the_response_is_in_um_over_s_with_the_fit_of_each_axis(measured: LoopRecord) -> None:
    figure = response_chart(measured, replace(measured, position=1.01 * measured.position)).figure()
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()) == ("x (µm)", "y (µm)", "time (s)")
    for axis, axes in enumerate(figure.axes):
        reference, plant, model = axes.get_lines()
        assert reference.get_label() == "reference"
        assert plant.get_xdata()[0] == pytest.approx(0.1)
        assert np.array_equal(plant.get_ydata(), 1e6 * measured.position[:, axis])
        assert model.get_label() == "model"
        assert "fit" in axes.get_title()


def test_the_plant_is_drawn_alone_where_there_is_no_model(measured: LoopRecord) -> None:
    assert len(orbit_chart(measured).figure().axes[0].get_lines()) == 1
    assert len(response_chart(measured).figure().axes[0].get_lines()) == 2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("value", "log"), [(3000.0, True), (3000.0, False), (-2.0, False), (0.0, False)])
def test_an_axis_of_a_single_value_has_room_around_it(value: float, log: bool) -> None:
    axis = Axis("speed (rpm)", log, limits=(value, value))
    item = Curve(np.full(1, value), np.ones(1), "", Stroke(BLUE))
    chart = Chart("speeds", "one speed", (Panel(axis, Axis("frequency (Hz)"), (item,)),))
    left, right = chart.figure().axes[0].get_xlim()
    assert left < value < right
    low, high = chart.page().layout.xaxis.range
    assert low < (np.log10(value) if log else value) < high


def test_figures_are_saved_as_png(measured: LoopRecord, tmp_path: Path) -> None:
    response_chart(measured, measured).figure().savefig(tmp_path / "response.png")
    orbit_chart(measured, measured).figure().savefig(tmp_path / "orbit.png")
    assert (tmp_path / "response.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "orbit.png").stat().st_size > 5_000


def test_plot_is_the_chart_that_shows_a_result_best(measured: LoopRecord) -> None:
    chart = plot(measured)
    assert (chart.title, chart.alt) == (response_chart(measured).title, response_chart(measured).alt)


def test_plot_of_something_else_names_what_has_a_chart() -> None:
    with pytest.raises(
        AmbError, match=r"there is no chart of a int; allowed: Campbell, Coherence, Distortion, .*LoopRecord"
    ):
        plot(3)
