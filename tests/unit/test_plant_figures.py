"""Figures of a plant: what they show, and the command that writes them."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.parameters import validate
from amb_core.plant import PlantParameters
from amb_core.plant.eddy import eddy_bandwidth
from amb_core.plant.figures import bandwidth_figure, force_figure, hysteresis_loop, iron_figure

LOOPS = {"iron.saturation": True, "iron.hysteresis": True}


def labels(figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].get_legend().get_texts()]


def test_hysteresis_loop_is_closed_and_has_the_coercive_field_of_the_material():
    field, density = hysteresis_loop(validate(PlantParameters, LOOPS).iron, peak=1.2)
    assert field[0] == pytest.approx(field[-1], abs=0.5)
    falling = np.flatnonzero(np.diff(density) < 0.0)
    coercive = -np.interp(0.0, density[falling][::-1], field[falling][::-1])
    assert 25.0 < coercive < 45.0  # A/m, silicon steel


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ({}, ["relative permeability 4000"]),
        ({"iron.saturation": True}, ["curve"]),
        (
            LOOPS,
            ["anhysteretic curve", *(f"loop of {peak} T" for peak in (0.4, 0.8, 1.2)), "minor loop, 0.9 T +/- 0.15 T"],
        ),
    ],
)
def test_iron_figure_shows_line_curve_or_loops(values, shown):
    assert labels(iron_figure(validate(PlantParameters, values))) == shown


def test_force_figure_shows_the_force_at_three_positions():
    centred, right, left = (line.get_ydata() for line in force_figure(PlantParameters()).axes[0].lines)
    np.testing.assert_allclose(centred, -centred[::-1], atol=1e-9)
    np.testing.assert_allclose(right, -np.asarray(left)[::-1], atol=1e-9)
    assert (right > centred).all()


def test_bandwidth_figure_marks_the_closed_form():
    parameters = validate(PlantParameters, {"iron.solid_journal": True})
    assert labels(bandwidth_figure(parameters)) == [f"-3 dB at {eddy_bandwidth(parameters):.3g} Hz"]


def test_command_writes_the_figures(tmp_path: Path):
    result = CliRunner().invoke(app, ["plant", "figures", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix) == ["bandwidth.png", "force.png", "iron.png"]


def test_command_says_what_cannot_be_drawn(tmp_path: Path):
    params = tmp_path / "one.yaml"
    params.write_text("/amb/simulator:\n  ros__parameters:\n    magnetic_circuit: {actuators: top_coil}\n")
    result = CliRunner().invoke(app, ["plant", "figures", "--params", str(params), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "bandwidth: not drawn" in result.output
    assert (tmp_path / "out" / "force.png").exists()
