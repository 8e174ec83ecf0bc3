"""Progress of a command: bars on a terminal, occasional plain lines if the output goes to a file or a pipe."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.text import Text

PERIOD = 10.0  # s, between plain lines of one stage


class Stages:
    """The stages of a command, one bar each, in the order in which they begin.

    Parameters
    ----------
    console : Console
        Where the command writes.
    unit : str, optional
        Name of the counted items, in the plural.
    """

    def __init__(self, console: Console, unit: str = "") -> None:
        self._shown: _Bars | _Lines = _Bars(console, unit) if console.is_interactive else _Lines(console, unit)

    def __enter__(self) -> Self:
        self._shown.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._shown.stop()

    def update(self, stage: str, done: int = 0, total: int | None = None, note: str = "") -> None:
        """Show the progress of a stage.

        Parameters
        ----------
        stage : str
            Name of the stage. It begins when it is first named.
        done, total : int, optional
            Finished items and number of all items; None while that is not known.
        note : str, optional
            A remark, such as a preliminary result.
        """
        self._shown.update(stage, done, total, note)


@contextmanager
def working(console: Console, text: str) -> Iterator[None]:
    """Show what a command does for some seconds, without a measure of progress."""
    if console.is_interactive:
        with console.status(Text(text)):  # a text alone would be markup
            yield
    else:
        console.print(f"{text} ...", highlight=False, markup=False)
        yield


class _Bars:
    def __init__(self, console: Console, unit: str) -> None:

        self._unit = unit
        self._tasks: dict[str, TaskID] = {}
        self._progress = Progress(
            TextColumn("{task.description:20}", markup=False),
            BarColumn(20),
            TextColumn("{task.fields[count]:>9}", markup=False),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}", markup=False),
            console=console,
        )

    def start(self) -> None:
        self._progress.start()

    def stop(self) -> None:
        self._progress.stop()

    def update(self, stage: str, done: int, total: int | None, note: str) -> None:
        count = _count(done, total, self._unit)
        if stage not in self._tasks:
            for task in self._progress.tasks:  # an iteration may have ended before its limit
                self._progress.update(task.id, total=task.completed or 1, completed=task.completed or 1)
            self._tasks[stage] = self._progress.add_task(stage, total=None, count="", note="")
        self._progress.update(self._tasks[stage], completed=done, total=total, count=count, note=note)


@dataclass
class _Line:
    """What was last printed about a stage, and when."""

    began: float
    printed: float
    ended: bool = False


class _Lines:
    def __init__(self, console: Console, unit: str) -> None:
        self._console, self._unit = console, unit
        self._stages: dict[str, _Line] = {}

    def start(self) -> None:
        """Nothing is shown before the first stage."""

    def stop(self) -> None:
        """Nothing to do: every line is complete."""

    def update(self, stage: str, done: int, total: int | None, note: str) -> None:
        now = time.monotonic()
        line = self._stages.get(stage)
        if line is None:
            line = self._stages[stage] = _Line(now, now)
        elif line.ended or (now - line.printed < PERIOD and done != total):
            return
        line.printed, line.ended = now, done == total
        if line.ended:
            words = [f"done in {now - line.began:.0f} s", note]
        else:
            words = [_count(done, total, self._unit), note, f"{now - line.began:.0f} s" if now > line.began else "..."]
        text = ", ".join(word for word in words if word)
        self._console.print(f"{stage}: {text}", highlight=False, markup=False, soft_wrap=True)


def _count(done: int, total: int | None, unit: str) -> str:
    if total is None or total == 1:
        return ""
    return f"{done:,} / {total:,} {unit}".rstrip()
