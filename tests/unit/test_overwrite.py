"""Commands replace files of others only with --overwrite; one rule for all."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import COMMANDS, LateCommand, app
from amb_bringup.commands.overwrite import PLACES
from amb_core.ground.errors import AmbError

DATA = Path(__file__).parents[1] / "data" / "own_data"


def identify(*words: str) -> str:
    result = CliRunner().invoke(
        app, ["identify", str(DATA / "suffixes.csv"), "--controller", "none", "--order", "2", *words]
    )
    if isinstance(result.exception, AmbError):
        return str(result.exception)
    assert result.exit_code == 0, result.output
    return ""


def test_a_file_that_exists_is_replaced_only_if_told(tmp_path: Path) -> None:
    out = tmp_path / "model.json"
    out.write_text("mine")
    assert "exists already; give another name, or --overwrite" in identify("--out", str(out))
    assert out.read_text() == "mine"
    description = tmp_path / "rig.yaml"
    description.write_text("mine")
    assert "exists already" in identify("--save-description", str(description))
    assert description.read_text() == "mine"
    assert identify("--out", str(out), "--overwrite") == ""
    assert out.read_text() != "mine"


@pytest.mark.parametrize(
    ("words", "out", "beside"),
    [
        (["report", str(DATA / "suffixes.csv"), "--pdf"], "page.html", "page.pdf"),
        (["plant", "ross", "rotor.toml"], "rotor.yaml", "rotor.npz"),
    ],
)
def test_a_file_beside_the_named_one_is_replaced_only_if_told(
    tmp_path: Path, words: list[str], out: str, beside: str
) -> None:
    theirs = tmp_path / beside
    theirs.write_text("mine")
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path / out)])
    assert str(result.exception) == f"{theirs}: exists already; give another name, or --overwrite"
    assert theirs.read_text() == "mine"


def test_a_pdf_that_is_not_asked_for_stays(tmp_path: Path) -> None:
    theirs = tmp_path / "page.pdf"
    theirs.write_text("mine")
    result = CliRunner().invoke(app, ["report", str(tmp_path / "no_bag"), "--out", str(tmp_path / "page.html")])
    assert "exists already" not in str(result.exception)
    assert theirs.read_text() == "mine"


def test_a_folder_with_files_of_others_is_used_only_if_told(tmp_path: Path) -> None:
    out = tmp_path / "results"
    out.mkdir()
    (out / "model.json").write_text("mine")
    assert "has files of others; give a new folder, or --overwrite" in identify("--out", str(out))
    assert (out / "model.json").read_text() == "mine"


def test_a_folder_of_results_is_written_again(tmp_path: Path) -> None:
    assert identify("--out", str(tmp_path / "new")) == ""
    assert identify("--out", str(tmp_path / "new")) == ""


@pytest.mark.parametrize(
    ("name", "place"), [(name, place) for listed in COMMANDS.values() for name, (place, _) in listed.items()]
)
def test_every_command_that_writes_has_the_option(name: str, place: str) -> None:
    loaded = LateCommand(name, place, "", "").load()
    commands = getattr(loaded, "commands", {name: loaded})
    for command in commands.values():
        options = {option for item in command.params for option in item.opts}
        if options & {f"--{place.replace('_', '-')}" for place in PLACES} and command.name != "recover":
            assert "--overwrite" in options, f"{name} {command.name}"
