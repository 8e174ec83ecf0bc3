"""`--out` means the same for every command: a folder of results or, by its ending, a file for the main one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.commands.results import ResultError, names_file
from amb_core.data.experiments import write_data
from amb_core.identification import IdentificationData, StateSpaceModel

COMMANDS = {
    "demo": [],
    "identify": ["data.npz"],
    "validate": ["model.json", "data.npz"],
    "compare": ["model.json", "data.npz"],
    "map": [],
    "regions": ["bag"],
    "report": ["bag"],
    "reproduce": [],
    "subharmonics": [],
    "plant figures": [],
}


def amb(*arguments: object) -> str:
    result = CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "160"})
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.output


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_where_a_folder_is_needed_is_one_line_before_any_work(command: str, tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("kept")
    with pytest.raises(ResultError, match=r"folder .*taken: cannot be made: there is a file of this name"):
        amb(*command.split(), *COMMANDS[command], "--out", file)
    assert file.read_text() == "kept"


def test_the_ending_says_whether_one_file_is_meant(tmp_path: Path) -> None:
    endings = (".json", ".npz")
    (tmp_path / "v1.2").mkdir()
    assert names_file(tmp_path / "model.NPZ", endings)
    assert not names_file(tmp_path / "results", endings)
    assert not names_file(tmp_path / "v1.2", endings)
    with pytest.raises(ResultError, match=r"must end in .json, .npz for a file, or have no ending for a folder"):
        names_file(tmp_path / "model.txt", endings)


def test_identify_and_validate_leave_all_results_in_the_folder(bearing, tmp_path: Path) -> None:
    for name, frequency in (("data", 15.0), ("other", 20.0)):
        record = bearing.experiment(2e-8, force=0.1, frequency=frequency, duration=0.4)
        write_data(IdentificationData.from_record(record, source=name), tmp_path / f"{name}.npz")
    amb("identify", tmp_path / "data.npz", "--order", "6", "--controller", "paper", "--out", tmp_path / "found")
    assert StateSpaceModel.load(tmp_path / "found/model.json").order == 6
    assert json.loads((tmp_path / "found/summary.json").read_text())["order"] == 6
    assert (tmp_path / "found/bode.png").exists()
    amb("validate", tmp_path / "found/model.json", tmp_path / "other.npz", "--out", tmp_path / "judged")
    assert (tmp_path / "judged/summary.json").exists()
    assert (tmp_path / "judged/residuals.html").exists()
