"""Campbell diagram: branches and critical speeds against closed forms, its figure, and the commands of modes."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import PlantError
from amb_core.linear.model.modes import Mode, Modes
from amb_core.loop.control import ControllerParameters
from amb_core.plant import ModalData, PlantParameters
from amb_core.plant.campbell import Campbell, campbell
from amb_core.report.figures import campbell_chart, plot

RIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / "rig.yaml"
OUTPUTS = ("x_a", "y_a", "x_b", "y_b")
FORWARD, BACKWARD = np.array([1.0, -1.0j, -1.0, 1.0j]), np.array([1.0, 1.0j, -1.0, -1.0j])
TRANSLATION = np.array([1.0, 0.0, 1.0, 0.0], dtype=complex)
TILT, RATIO, TRANSLATING, ZETA = 50.0, 0.5, 45.0, 0.1  # Hz, I_p / I_t, Hz, -


def tilts(speed: float) -> tuple[float, float]:
    """Forward and backward frequency of an undamped tilt on springs: f^2 - (I_p / I_t) Omega f - f_0^2 = 0 (Hz)."""
    half = 0.5 * RATIO * speed
    return float(np.hypot(half, TILT) + half), float(np.hypot(half, TILT) - half)


def mode(hz: float, shape: np.ndarray, whirl: str, kind: str) -> Mode:
    rate = 2.0 * np.pi * hz * complex(-ZETA / np.sqrt(1.0 - ZETA**2), 1.0)
    return Mode(rate, shape, 1.0, whirl, kind)


def closed_form(speeds: np.ndarray) -> Campbell:
    """A gyroscopic tilt and a translation that its backward branch crosses."""
    loops = []
    for speed in speeds:
        forward, backward = tilts(speed)
        modes = (
            mode(forward, FORWARD, "forward", "nutation"),
            mode(backward, BACKWARD, "backward", "precession"),
            mode(TRANSLATING, TRANSLATION, "planar", "translation"),
        )
        loops.append(Modes(tuple(sorted(modes, key=lambda item: abs(item.rate))), OUTPUTS))
    return Campbell(speeds, tuple(loops), tuple(loops))


@pytest.fixture(scope="module")
def diagram() -> Campbell:
    return closed_form(np.linspace(0.0, 120.0, 25))


def test_branches_follow_a_mode_through_a_crossing(diagram):
    assert len(diagram.branches) == 3
    for branch in diagram.branches:
        assert len({item.kind for item in branch.modes}) == 1
        assert len(branch.speed) == len(diagram.speed)


def test_critical_speeds_are_those_of_the_closed_form(diagram):
    """1x: f = Omega in f^2 - rho Omega f - f_0^2 = 0 is f_0 / sqrt(1 - rho) forward; backward f_0 / sqrt(1 + rho)."""
    critical = {item.kind: item for item in diagram.critical_speeds}
    assert critical["nutation"].speed == pytest.approx(TILT / np.sqrt(1.0 - RATIO), rel=1e-3)
    assert critical["precession"].speed == pytest.approx(TILT / np.sqrt(1.0 + RATIO), rel=1e-3)
    assert critical["translation"].speed == pytest.approx(TRANSLATING, rel=1e-9)
    assert critical["translation"].rpm == pytest.approx(2700.0)
    assert critical["nutation"].amplification == pytest.approx(0.5 / ZETA)
    assert not critical["nutation"].critically_damped
    speeds = [item.speed for item in diagram.critical_speeds]
    assert speeds == sorted(speeds)


def test_the_figure_marks_whirl_critical_speeds_and_identified_modes(diagram):
    identified = [(50.0, diagram.closed_loop[10])]
    chart = campbell_chart(diagram, identified)
    labels = [item.label for item in chart.panels[0].items]
    assert {"forward whirl", "backward whirl", "planar whirl", "running speed (1x)", "critical speed"} < set(labels)
    assert {"identified, forward", "identified, backward"} < set(labels)
    assert len(chart.table.rows) == 3
    assert "2700 rpm" in chart.alt
    assert plot(diagram).title == "Campbell diagram"
    assert chart.figure().axes


@pytest.mark.parametrize("speeds", [[], [10.0, 5.0], [1.0, 1.0]])
def test_speeds_must_ascend(speeds):
    with pytest.raises(PlantError, match="needed: at least one, ascending"):
        campbell(PlantParameters(), ControllerParameters(), speeds)


def test_command_writes_diagram_and_numbers(tmp_path):
    arguments = [
        "plant",
        "campbell",
        "--params",
        str(RIG),
        "--max-speed",
        "6000",
        "--speeds",
        "3",
        "--out",
        str(tmp_path),
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert {"campbell.png", "campbell.html", "campbell.json"} < {path.name for path in tmp_path.iterdir()}
    content = json.loads((tmp_path / "campbell.json").read_text())
    assert content["stable"]
    assert [row["rpm"] for row in content["speeds"]] == [0.0, 3000.0, 6000.0]
    at_speed = {item["kind"]: item for item in content["speeds"][-1]["closed_loop"]}
    assert at_speed["nutation"]["natural_hz"] > at_speed["precession"]["natural_hz"]
    assert len(content["critical_speeds"]) == 4
    assert all(item["critically_damped"] for item in content["critical_speeds"])


def test_command_prints_the_modes_of_loop_and_plant():
    arguments = ["plant", "modes", "--params", str(RIG), "--set", "rotor.running_speed=100"]
    printed = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert sorted(item["kind"] for item in printed["closed"]) == [
        "nutation", "precession", "translation", "translation",
    ]  # fmt: skip
    assert sum(not item["stable"] for item in printed["plant"]) == 3  # two real poles, and one pair of the tilts
    table = CliRunner().invoke(app, arguments, env={"COLUMNS": "160"}).stdout
    assert "nutation" in table
    assert "6000 rpm" in table


def test_command_writes_the_modes_of_a_shaft(tmp_path):
    path = tmp_path / "made" / "shaft.npz"
    arguments = ["plant", "shaft", "--length", "0.9", "--diameter", "0.048", "--bearings", "0.3", "--out", str(path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "272.8 Hz" in result.output
    assert ModalData.load(path).modes == 10
