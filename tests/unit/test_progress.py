"""How far commands are: bars on a terminal, plain lines where the output is redirected."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from amb_bringup.commands import progress
from amb_bringup.commands.progress import Stages, working


class Clock:
    """Wall clock of the plain lines."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress, "time", clock)
    return clock


def test_redirected_output_gets_a_line_when_a_stage_begins_now_and_then_and_when_it_ends(clock: Clock) -> None:
    file = io.StringIO()
    with Stages(Console(file=file, width=200), "steps") as stages:
        for done in range(0, 3001, 5):
            clock.now = 0.01 * done
            stages.update("square waves", done, 3000)
    assert file.getvalue().splitlines() == [
        "square waves: 0 / 3,000 steps, ...",
        "square waves: 1,000 / 3,000 steps, 10 s",
        "square waves: 2,000 / 3,000 steps, 20 s",
        "square waves: done in 30 s",
    ]


def test_a_stage_that_is_not_counted_has_its_lines_too(clock: Clock) -> None:
    file = io.StringIO()
    with Stages(Console(file=file, width=200)) as stages:
        stages.update("checks", 0, 1)
        clock.now = 2.0
        stages.update("checks", 1, 1)
        stages.update("reading")
        clock.now = 13.0
        stages.update("reading", note="[half] of it")
    assert file.getvalue().splitlines() == [
        "checks: ...",
        "checks: done in 2 s",
        "reading: ...",
        "reading: [half] of it, 11 s",
    ]


def test_what_only_takes_a_while_is_named() -> None:
    file = io.StringIO()
    with working(Console(file=file), "drawing"):
        assert file.getvalue() == "drawing ...\n"


def test_a_terminal_gets_bars_with_count_and_note() -> None:
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=120, _environ={"TERM": "xterm"})
    with Stages(console, "steps") as stages:
        stages.update("checks", 1, 3)
        stages.update("pem", 30, 60, "cost 1.5")
    shown = file.getvalue()
    assert "━" in shown
    assert "30 / 60 steps" in shown
    assert "cost 1.5" in shown
