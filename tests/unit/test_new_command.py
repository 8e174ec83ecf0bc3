"""`amb new` and `amb tune`: from a few answers to a file, its gains and their chart."""

from __future__ import annotations

import os
import pty
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.graph.node_parameters import check_parameter_file
from amb_bringup.graph.packages import find_executable
from amb_core.ground.errors import AmbError
from amb_core.ground.parameters import load_parameters
from amb_core.loop.control import ControllerParameters
from amb_sim_node.parameters import SimulatorParameters

ANSWERS = {"gap": "0.4mm", "turns": "60", "mass": "4kg", "bias-current": "2.5", "voltage": "150V"}


def amb(*words: str | Path) -> str:
    result = CliRunner().invoke(app, list(map(str, words)), catch_exceptions=False, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    return result.output


def options(**other: str) -> list[str]:
    return [word for name, value in (ANSWERS | other).items() for word in (f"--{name}", value)]


def test_a_file_is_written_that_all_nodes_take(tmp_path: Path) -> None:
    file = tmp_path / "my_bearing.yaml"
    shown = amb("new", file, *options())
    for quantity in (
        "stiffness",
        "damping",
        "peak sensitivity",
        "phase margin",
        "lifts the rotor off",
        "amb tune chart",
    ):
        assert quantity in shown
    check_parameter_file(file)
    assert load_parameters(SimulatorParameters, file, "simulator").rotor.mass == 4.0
    with pytest.raises(AmbError, match="exists already; give another name, or --overwrite"):
        amb("new", file, *options())

    tuned = tmp_path / "tuned.yaml"
    assert "PD gains for" in amb("tune", "gains", file, "--out", tuned, "--set", "rotor.mass=5")
    check_parameter_file(tuned)
    given, heavier = (load_parameters(ControllerParameters, path, "pd_controller", part=True) for path in (file, tuned))
    assert heavier.derivative_gain > given.derivative_gain  # of the heavier rotor

    assert "peak sensitivity" in amb("tune", "chart", tuned, "--points", "10", "--out", tmp_path / "tune")
    assert (tmp_path / "tune" / "stability.png").stat().st_size > 10_000
    assert "plotly" in (tmp_path / "tune" / "stability.html").read_text()


@pytest.mark.parametrize(("rate", "highest"), [("1kHz", "0.4kHz"), ("10kHz", "1.5kHz")])
def test_the_first_experiment_stays_below_half_the_sample_rate(tmp_path: Path, rate: str, highest: str) -> None:
    light = options(gap="0.8mm", turns="100", mass="1kg", **{"bias-current": "1.2", "sample-rate": rate})
    assert f"--frequency-end {highest} --params" in amb("new", tmp_path / "light.yaml", *light)


def test_questions_are_asked_on_a_terminal_until_the_answer_is_a_quantity(tmp_path: Path) -> None:
    file = tmp_path / "asked.yaml"
    ours, theirs = pty.openpty()
    answers = ["wide", *ANSWERS.values(), "", "", ""]  # the last three: defaults
    os.write(ours, "".join(f"{answer}\n" for answer in answers).encode())
    command = [str(find_executable("amb_bringup", "amb")), "new", str(file)]
    done = subprocess.run(command, stdin=theirs, capture_output=True, text=True, check=False)
    os.close(ours)
    os.close(theirs)
    assert done.returncode == 0, done.stderr
    assert "'wide' is not a number; allowed: a number in m" in done.stderr
    assert "Air gap between pole and journal" in done.stdout
    assert load_parameters(SimulatorParameters, file, "simulator").magnetic_circuit.air_gap == 0.4e-3


def test_without_a_terminal_the_missing_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(AmbError, match="a bearing needs --turns --mass --bias-current --voltage; see amb new --help"):
        amb("new", tmp_path / "no.yaml", "--gap", "0.4mm")


def test_a_refused_file_leaves_the_one_of_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("before\n")
    monkeypatch.setattr("amb_bringup.commands.new.parameter_file_of", lambda _: "/amb/simulator: 3\n")
    with pytest.raises(AmbError):
        amb("new", file, *options(), "--overwrite")
    assert file.read_text() == "before\n"
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"]


def test_a_chart_of_axes_with_gains_of_their_own_says_whose_it_is(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text("/amb/pd_controller:\n  ros__parameters: {derivative_gains: [38.0, 0.5]}\n")
    said = amb("tune", "chart", file, "--points", "8", "--out", tmp_path / "tune")
    assert "the axes have gains of their own; the chart has those of x on all" in said
    assert "unstable" in said


def test_a_bearing_that_cannot_levitate_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(AmbError, match="static load beyond the force"):
        amb("new", tmp_path / "no.yaml", *options(mass="400kg"))
    assert not (tmp_path / "no.yaml").exists()
