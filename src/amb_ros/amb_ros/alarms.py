"""When alarms of a node began and ended: one that is over leaves OK behind, and a record of when it was."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

KEPT = 3  # alarms, of those that follow each other
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
    """The last alarms of a node that are over: the gravest since all was well. Other numbers make no other alarm.

    Attributes
    ----------
    last : str
        What they were, and from when to when, the latest `KEPT` of them; empty if there were none.
    """

    def __init__(self) -> None:
        self.last = ""
        self._over: list[tuple[int, str]] = []  # level and text, since all was well
        self._level = 0
        self._text = ""
        self._since = ""

    def note(self, level: int, text: str, now: str) -> None:
        """The node reports a level, 0 if all is well, with a text, at a time."""
        if (level, _without_numbers(text)) != (self._level, _without_numbers(self._text)):
            if self._level:
                self._file(now)
            else:
                self._over = []
            self._level, self._since = level, now
        self._text = text

    def _file(self, now: str) -> None:
        self._over.append((self._level, f"{self._text} (from {self._since} to {now})"))
        gravest = max(level for level, _ in self._over)
        self._over = [(level, text) for level, text in self._over if level == gravest][-KEPT:]
        self.last = "; ".join(text for _, text in self._over)


def _without_numbers(text: str) -> str:
    return re.sub(r"\d+", "", text)
