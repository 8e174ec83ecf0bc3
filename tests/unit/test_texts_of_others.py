"""Texts of files, topics and pages of others control neither terminal nor page."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app, main
from amb_core.ground.errors import LONGEST_TEXT, BagError, bounded, one_line
from amb_core.ground.plain_text import is_for_ros, plain_text
from amb_core.recording import BagWriter
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Note, Panel
from amb_core.report.figures.style import BLUE, Stroke

HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202ereversed"


def shown(*words: str) -> str:
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.exception
    return result.output


def test_controls_are_shown_and_letters_stay() -> None:
    assert plain_text(HOSTILE) == r"\x1b]0;owned\x07\x1b[2J\x9b31m\u202ereversed"
    assert plain_text("Lage X [µm]\t変位\nرمز") == "Lage X [µm]\t変位\nرمز"


@pytest.mark.parametrize("text", ["a\ud800b", "rig \udcff.mcap", "a\0b", HOSTILE])
def test_the_text_of_an_error_is_one_that_ros_carries(text: str) -> None:
    for shown_text in (one_line(BagError(f"{text}\n is wrong")), bounded(text)):
        assert is_for_ros(shown_text)
        assert shown_text.isprintable()
        shown_text.encode()


@pytest.mark.parametrize("text", ["x" * 5_000, "\ud800" * 5_000, "\U000e0001" * 400])
def test_a_bounded_text_is_not_longer_than_it_may_be(text: str) -> None:
    assert len(bounded(text)) <= LONGEST_TEXT
    assert len(bounded(text, 51)) <= 51
    assert " ... " in bounded(text)


def test_names_of_topics_reach_the_terminal_as_text(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder) as bag:
        for name in ("/[red]y", "/[/x]", "/[link=http://evil]z", f"/{HOSTILE}"):
            bag.add_topic(name, "amb_msgs/msg/Made", "uint8 a\n")
            bag.write(name, b"\x00\x01\x00\x00\x07", 1)
    for words in (("bag", "info"), ("bag", "recover")):
        output = shown(*words, str(folder))
        for name in ("/[red]y", "/[/x]", "/[link=http://evil]z", r"/\x1b]0;owned"):
            assert name in output
        assert not set("\x1b\x07\x9b\u202e") & set(output)


def test_headings_reach_the_terminal_as_text(tmp_path: Path) -> None:
    file = tmp_path / "own.csv"
    rows = "".join(f"{k / 8000:.7f},{np.sin(k):.6f},{np.cos(k):.6f}\n" for k in range(50))
    file.write_text(f"t [s],i {HOSTILE} [/x] [A],y [red] [um]\n{rows}")
    result = CliRunner().invoke(app, ["identify", str(file), "--controller", "none"], env={"COLUMNS": "200"})
    assert not set("\x1b\x07\x9b\u202e") & set(result.output)


def test_an_error_reaches_the_terminal_as_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "own.csv"
    file.write_text(f"{HOSTILE},b\n1,2\n3,4\n5,6\n")
    monkeypatch.setattr("sys.argv", ["amb", "identify", str(file)])
    monkeypatch.setattr("signal.signal", lambda *_: None)  # main() would take Ctrl-C from pytest
    assert main() == 1
    error = capsys.readouterr().err
    assert r"\x1b]0;owned\x07" in error
    assert "\x1b" not in error


@pytest.mark.parametrize("text", ["$\\frac{$", "$x^$ a", "a_$b$ $", HOSTILE])
def test_a_figure_shows_a_text_with_dollar_signs(tmp_path: Path, text: str) -> None:
    x = np.linspace(0.0, 1.0, 5)
    panel = Panel(Axis(text), Axis(text), (Curve(x, x, text, Stroke(BLUE)),), title=text)
    Chart(text, text, (panel,)).save(tmp_path, "chart")


def test_a_page_makes_no_link_of_a_text_and_runs_nothing_from_elsewhere(tmp_path: Path) -> None:
    link = '<a href="javascript:alert(1)">here</a><b onclick=1>x</b>'
    x = np.linspace(0.0, 1.0, 5)
    panel = Panel(Axis(link), Axis("y"), (Curve(x, x, link, Stroke(BLUE)), Note(0.5, 0.5, "A")), title=link)
    _, page = Chart(link, link, (panel,)).save(tmp_path, "chart")
    text = page.read_text()
    assert not re.search(r"<a\b|<b onclick", text)
    assert '"<b>A<\\/b>"' in text
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy and "default-src &#39;none&#39;" in policy[1] and "unsafe-inline&#39;; img" in policy[1]
    assert "script-src &#39;self&#39; file: &#39;sha256-" in policy[1]


def test_a_terminal_without_our_signs_shows_others(tmp_path: Path) -> None:
    ascii_only = os.environ | {"PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    described = subprocess.run(
        ["amb", "plant", "describe"], cwd=tmp_path, env=ascii_only, capture_output=True, check=False
    )
    assert described.returncode == 0, described.stderr
    assert b"integration.sample_rate" in described.stdout
