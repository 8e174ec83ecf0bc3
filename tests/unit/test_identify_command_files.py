"""`amb identify` and `amb validate` of data files of any size: one command each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import AmbError
from amb_core.identification import StateSpaceModel
from tests.linear_process import LinearProcess

PROCESS = LinearProcess(4, 4)
ARM = LinearProcess(1, 1, order=4, feedthrough=True)


@pytest.fixture(scope="module")
def process(tmp_path_factory) -> Path:
    """A 4x4 process: a time column, then four inputs and four outputs, in one matrix without sample time."""
    item = PROCESS.data(3_000).experiments[0]
    path = tmp_path_factory.mktemp("process") / "process.mat"
    savemat(path, {"process": np.hstack([0.5 * np.arange(3_000)[:, np.newaxis], item.inputs, item.outputs])})
    return path


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Path:
    """A 1x1 arm that responds within the sample: u, y and Ts."""
    item = ARM.data(2_000).experiments[0]
    path = tmp_path_factory.mktemp("arm") / "arm.mat"
    savemat(path, {"u": item.inputs, "y": item.outputs, "Ts": 0.5})
    return path


def run(*words: object) -> str:
    result = CliRunner().invoke(app, list(map(str, words)), env={"COLUMNS": "160"})
    if result.exception is not None and not (isinstance(result.exception, SystemExit) and not result.exit_code):
        raise result.exception
    return result.output


COLUMNS = ("--inputs", "1-4", "--outputs", "5-8", "--sample-time", 0.5)


def test_a_process_of_four_inputs_and_outputs_is_identified_by_one_command(process: Path, tmp_path: Path) -> None:
    shown = run("identify", process, *COLUMNS, "--order", 6, "--out", tmp_path / "run")
    assert "6; 4 inputs, 4 outputs" in shown and "closed-loop fit" not in shown
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert list(summary["innovation_rms"]) == ["y1", "y2", "y3", "y4"] and summary["unstable_poles"] == 0
    assert PROCESS.response_error(StateSpaceModel.load(tmp_path / "run" / "model.json")) < 0.04
    assert (tmp_path / "run" / "bode.png").exists()
    page = run("validate", tmp_path / "run" / "model.json", process, *COLUMNS)
    assert "VERDICT      validated" in page


def test_an_arm_of_one_input_and_output_is_identified_by_one_command(arm: Path, tmp_path: Path) -> None:
    shown = run("identify", arm, "--order", "auto", "--feedthrough", "--out", tmp_path / "model.mat")
    assert "order by BIC" in shown and "4; 1 inputs, 1 outputs, direct feedthrough" in shown
    assert ARM.response_error(StateSpaceModel.load(tmp_path / "model.mat")) < 0.03


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "which of the 9 columns are inputs and which outputs is not known; give inputs and outputs"),
        (("--inputs", "1-4"), "which of the 9 columns are inputs and which outputs is not known"),
        (("--inputs", "1-4", "--outputs", "5-9"), "there is no column 9; allowed: 0 to 8"),
        (
            ("--inputs", "1-4", "--outputs", "y1"),
            "--outputs: there must be one column 'y1'; there are process",
        ),
        (("--inputs", "1-4", "--outputs", "5-8"), "the sample time is not known; give sample_time in s"),
        ((*COLUMNS, "--variable", "other"), r"has no matrix other; its matrices: process \(3000, 9\)"),
        ((*COLUMNS, "--order", 41), "order 41 is not allowed; allowed: 1 to 40"),
    ],
)
def test_what_a_file_leaves_open_is_asked_for_in_one_line(process: Path, options: tuple, message: str) -> None:
    with pytest.raises(AmbError, match=message):
        run("identify", process, *options)
