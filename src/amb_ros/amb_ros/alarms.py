"""When alarms of a node began and ended: one that is over leaves OK behind, and a record of when it was."""

from __future__ import annotations

import time
from collections.abc import Callable

HOLD = 5.0  # s for which a single event is shown: long enough for a display that looks now and then


class RecentProblem:
    """A problem that consists of events, such as messages refused: present until `HOLD` after the last of them.

    Parameters
    ----------
    clock : callable, optional
        Steady time (s).

    Attributes
    ----------
    last : str
        The last event, however long ago; empty if there was none.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.last = ""
        self._clock = clock
        self._time = 0.0  # of the last event

    def note(self, text: str) -> bool:
        """An event has happened. Returns whether there was no problem before."""
        begins = not self.text
        self.last, self._time = text, self._clock()
        return begins

    @property
    def text(self) -> str:
        """The last event; empty once it is long enough ago."""
        return self.last if self._clock() - self._time < HOLD else ""


class AlarmRecord:
    """The last alarm of a node that is over.

    Attributes
    ----------
    last : str
        What it was, and from when to when; empty if there was none.
    """

    def __init__(self) -> None:
        self.last = ""
        self._level = 0
        self._text = ""
        self._since = ""

    def note(self, level: int, text: str, now: str) -> None:
        """The node reports a level, 0 if all is well, with a text, at a time."""
        if level < self._level:
            self.last = f"{self._text} (from {self._since} to {now})"
        if level != self._level:
            self._level, self._since = level, now
        self._text = text
