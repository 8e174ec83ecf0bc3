"""Commands replace files of others only with --overwrite; one rule for all."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import COMMANDS, LateCommand, app
from amb_bringup.client.errors import ClientError
from amb_bringup.commands.overwrite import MARK, PLACES
from amb_bringup.demos import demo_run, rig_demo
from amb_bringup.graph import own_graph
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


def test_a_call_that_has_written_nothing_claims_no_folder_of_others(tmp_path: Path) -> None:
    theirs = tmp_path / "summary.json"
    theirs.write_text("mine")
    words = ["regions", "no_bag", "--out", str(tmp_path)]
    for option in (["--overwrite"], []):
        CliRunner().invoke(app, [*words, *option])
        assert not (tmp_path / MARK).exists()
    assert "has files of others" in str(CliRunner().invoke(app, words).exception)


def test_a_folder_of_others_in_which_a_command_has_written_is_its_own(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert identify("--out", str(tmp_path), "--overwrite") == ""
    assert identify("--out", str(tmp_path)) == ""


RECORDING = {
    "commission": (["commission", "--emulator", "--yes"], "protocol.json", {"result": "failed", "steps": []}),
    "demo": (["demo"], "summary.json", {"bit_identical": True}),
    "rig demo": (["rig", "demo"], "summary.json", {"bag": "bag"}),
}
"""Commands that replace the bag of an earlier call, the file by which they know it, and some of its content."""


def folder_with_bag(folder: Path, name: str = "", content: Any = None) -> Path:
    """A folder in which a command has recorded; returns what stands for the samples."""
    samples = folder / "bag" / "bag_0.mcap"
    samples.parent.mkdir(parents=True)
    samples.write_text("samples")
    (folder / MARK).touch()
    if name:
        (folder / name).write_text(json.dumps(content))
    return samples


def without_a_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_arguments: Any, **_more: Any) -> NoReturn:
        raise ClientError("no graph here")

    for module in (own_graph, demo_run, rig_demo):
        monkeypatch.setattr(module, "own_graph", refused)
    monkeypatch.setattr(rig_demo, "_load_on_a_map", lambda *_: 0.1)  # takes seconds


@pytest.mark.parametrize("command", RECORDING)
def test_a_bag_that_another_command_has_made_is_replaced_only_if_told(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_a_graph(monkeypatch)
    words, _, _ = RECORDING[command]
    makers = [
        ("", None),
        ("summary.json", {"mine": 1}),
        *(RECORDING[name][1:] for name in RECORDING if name != command),
    ]
    for place, (name, content) in enumerate(makers):
        out = tmp_path / str(place)
        samples = folder_with_bag(out, name, content)
        refusal = str(CliRunner().invoke(app, [*words, "--out", str(out)]).exception)
        assert refusal == f"{samples.parent}: was not made by this command; give another folder, or --overwrite"
        assert str(CliRunner().invoke(app, [*words, "--out", str(out), "--overwrite"]).exception) == "no graph here"


@pytest.mark.parametrize("command", RECORDING)
def test_its_own_bag_is_replaced_but_not_before_the_graph_runs(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_a_graph(monkeypatch)
    words, name, content = RECORDING[command]
    samples = folder_with_bag(tmp_path / "out", name, content)
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "out")])
    assert str(result.exception) == "no graph here"
    assert samples.exists() and (tmp_path / "out" / name).exists()


@pytest.mark.parametrize("clear", [True, False])
def test_a_demo_removes_the_results_of_an_earlier_one_only_if_told(
    clear: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = folder_with_bag(tmp_path, "summary.json", {})
    notes = tmp_path / "notes.txt"
    notes.touch()

    def full(_bag: Path) -> NoReturn:
        raise ClientError("no room for a bag")

    amb = SimpleNamespace(start_recording=full)
    monkeypatch.setattr(demo_run, "own_graph", lambda *_, **__: nullcontext((None, amb)))
    with pytest.raises(ClientError, match="no room for a bag"):
        demo_run.run_graph([], 4, tmp_path, tmp_path / "my.yaml", 1, lambda *_: None, clear=clear)
    assert samples.exists() is (tmp_path / "summary.json").exists() is not clear
    assert notes.exists()


@pytest.mark.parametrize("command", RECORDING)
def test_the_default_place_is_that_of_the_command_whatever_has_become_of_an_earlier_call(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_a_graph(monkeypatch)
    monkeypatch.chdir(tmp_path)
    folder_with_bag(Path("results") / {"rig demo": "rig-demo"}.get(command, command))
    assert str(CliRunner().invoke(app, RECORDING[command][0]).exception) == "no graph here"


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
