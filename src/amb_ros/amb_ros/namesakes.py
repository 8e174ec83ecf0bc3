"""Nodes of one name that live at the same time, distinguished by what each reports about itself."""

from __future__ import annotations

import time
from collections.abc import Callable

KEPT_INSTANCES = 4  # of a name
KEPT_NAMES = 1000  # of nodes, whoever reports


class Namesakes:
    """Notices when two instances of a node report in turn.

    The graph alone does not show it: a node that was killed stays there for some 20 s beside the one that was started
    in its place. Reports do: of two that live, the first reports again after the second.

    Parameters
    ----------
    patience : float
        Time without such a report after which only one instance is taken to live (s).
    clock : callable, optional
        Steady time (s).
    """

    def __init__(self, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._instances: dict[str, list[str]] = {}  # by name, the one that reported last at the end
        self._alternated: dict[str, float] = {}  # when an instance last reported again after another one

    def note(self, name: str, instance: str) -> None:
        """An instance of a node reports."""
        known = self._instances.setdefault(name, [])
        if known and known[-1] == instance:
            return
        if instance in known:
            self._alternated[name] = self._clock()
            known.remove(instance)
        known.append(instance)
        del known[:-KEPT_INSTANCES]
        if len(self._instances) > KEPT_NAMES:
            self._instances.pop(next(iter(self._instances)))

    def lives_twice(self, name: str) -> bool:
        """Whether two instances of a node of this name live."""
        return name in self._alternated and self._clock() - self._alternated[name] < self._patience
