"""A machine of one axis, in files of others, through the commands from identification to report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from tests.lqg_loop import SAMPLE_TIME, linear_law, rotor

COLUMNS = "--inputs", "Strom", "--outputs", "Ist", "--reference", "Soll"


def run(*words: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "160"}, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, the controller as numpy saves its matrices, and what identification left."""
    folder = tmp_path_factory.mktemp("one_axis")
    law = rotor(1).lqg()
    np.savez(folder / "law.npz", A=law.a, B=law.b, C=law.c, D=law.d, Ts=law.sample_time)
    for seed, name in enumerate(("one.csv", "other.csv")):
        record = rotor(1).record(linear_law(law, 1), 12_000, seed)
        times = SAMPLE_TIME * np.arange(record.steps)
        columns = np.column_stack([times, 1e3 * record.reference, 1e3 * record.position, record.current])
        np.savetxt(folder / name, columns, delimiter=",", header="t [s],Soll [mm],Ist [mm],Strom [A]", comments="")
    run(
        "identify", folder / "one.csv", *COLUMNS, "--controller", folder / "law.npz", "--order", 3,
        "--out", folder / "model", "--save-description", folder / "columns.yaml",
    )  # fmt: skip
    return folder


def described(folder: Path) -> tuple[object, ...]:
    return "--description", folder / "columns.yaml"


def test_it_is_identified_with_figures_but_without_an_orbit(folder: Path) -> None:
    assert json.loads((folder / "model" / "summary.json").read_text())["unstable_poles"] == 1
    drawn = {path.name for path in (folder / "model").glob("*.png")}
    assert {"response.png", "bode.png", "poles.png"} <= drawn
    assert "orbit.png" not in drawn


def test_its_model_is_validated_on_the_other_recording(folder: Path, tmp_path: Path) -> None:
    said = run("validate", folder / "model" / "model.json", folder / "other.csv", *described(folder), "--out", tmp_path)
    assert "VERDICT      validated" in said
    assert "Ist" in run("compare", folder / "model" / "model.json", folder / "other.csv", *described(folder))


def test_its_regions_and_its_distortion_are_measured(folder: Path, tmp_path: Path) -> None:
    said = run("regions", folder / "one.csv", *described(folder), "--out", tmp_path, "--clearance", "250um")
    assert "region A" in said
    assert "noise and distortion together" in said and "not allowed" not in said
    assert json.loads((tmp_path / "summary.json").read_text())["shares"]["A"] == 1.0


def test_its_report_says_that_it_was_excited(folder: Path, tmp_path: Path) -> None:
    run("report", folder / "one.csv", *described(folder), "--out", tmp_path / "report.html", "--order", 3)
    page = (tmp_path / "report.html").read_text()
    texts = ("with a moving reference", "without excitation", "noise and distortion together", "run and steps")
    assert [text for text in texts if text in page] == ["with a moving reference", "noise and distortion together"]
