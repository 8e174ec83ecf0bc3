"""Campbell diagram: branches and critical speeds against closed forms, its figure, and the commands of modes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import validate
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
        loops.append(Modes(tuple(sorted(modes, key=lambda item: abs(item.rate))), OUTPUTS, np.zeros(0)))
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


def test_speeds_are_added_where_modes_move_too_far_to_be_followed():
    """A disc of I_p / I_t = 0.48 and steps of 5000 rpm; 100 speeds up to 15000 rpm have these critical speeds."""
    disc = {"rotor.model": "rigid", "rotor.gravity": 0.0, "rigid_rotor.polar_inertia": 0.12}
    given = np.linspace(0.0, 15_000.0, 4) / 60.0
    steps: list[tuple[str, int, int | None]] = []
    found = campbell(validate(PlantParameters, disc), ControllerParameters(), given, lambda *step: steps.append(step))
    assert [item.kind for item in found.critical_speeds] == ["precession", "translation", "translation", "nutation"]
    np.testing.assert_allclose([item.rpm for item in found.critical_speeds], [2794, 3265, 3265, 4927], rtol=0.01)
    assert set(given) < set(found.speed)
    assert len(found.speed) < 30
    assert not found.gaps
    assert steps[3] == ("modes", 4, 4)


def test_a_crossing_that_no_branch_has_is_reported():
    """From 10 to 400 Hz the precession falls, and the nutation rises, by more than a branch may."""
    coarse = closed_form(np.array([0.0, 10.0, 400.0]))
    assert coarse.gaps == ((10.0, 400.0),)
    words = "between 600 and 24000 rpm the modes cannot be followed: take more speeds"
    assert coarse.remarks == (words,)
    assert coarse.to_json()["not_followed_rpm"] == [[600.0, 24000.0]]
    assert words in campbell_chart(coarse).alt
    fine = closed_form(np.linspace(0.0, 120.0, 25))
    assert fine.gaps == ()
    assert fine.to_json()["not_followed_rpm"] == []


def test_a_mode_whose_gain_becomes_too_small_is_no_gap():
    loops = []
    for gain in (0.011, 0.009):
        fading = replace(mode(TRANSLATING, TRANSLATION, "planar", "translation"), gain=gain)
        loops.append(Modes((fading,), OUTPUTS, np.zeros(0)))
    assert Campbell(np.array([10.0, 20.0]), tuple(loops), tuple(loops)).gaps == ()


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


def test_a_loop_that_alternates_at_half_the_sample_rate_is_called_unstable(tmp_path):
    """1 kHz and far too much derivative gain: the unstable pole is real and beyond -1, so no mode shows it."""
    unstable = ["--set", "integration.sample_rate=1000", "--set", "controller.derivative_gain=1500"]
    arguments = ["plant", "campbell", *unstable, "--speeds", "2", "--out", str(tmp_path)]
    assert "the loop is unstable at some of the speeds" in CliRunner().invoke(app, arguments).output
    assert not json.loads((tmp_path / "campbell.json").read_text())["stable"]
    table = CliRunner().invoke(app, ["plant", "modes", *unstable], env={"COLUMNS": "160"}).stdout
    assert "poles beyond half the sample rate, unstable" in table


def test_command_writes_the_modes_of_a_shaft(tmp_path):
    path = tmp_path / "made" / "shaft.npz"
    arguments = ["plant", "shaft", "--length", "0.9", "--diameter", "0.048", "--bearings", "0.3", "--out", str(path)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "272.8 Hz" in result.output
    assert ModalData.load(path).modes == 10
