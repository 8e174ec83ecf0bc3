"""Detects nodes of the same name that run at the same time, from what each reports about itself."""

from __future__ import annotations

import time
from collections.abc import Callable

KEPT_INSTANCES = 4  # per name
KEPT_NAMES = 1000  # of all nodes that report
LONGEST_NAME = 300  # characters of a name or an instance; longer ones are of no node of ours


class Namesakes:
    """Detects that two instances of a node report alternately.

    The graph alone does not show it: a killed node stays in the graph for about 20 s beside its replacement. Reports
    show it: if both instances run, the first one reports again after the second.

    Parameters
    ----------
    patience : float
        Time without such a report after which only one instance is assumed to run (s).
    clock : callable, optional
        Steady time (s).
    """

    def __init__(self, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience = patience
        self._clock = clock
        self._instances: dict[str, list[str]] = {}  # by name, the one that reported last at the end
        self._alternated: dict[str, float] = {}  # when an instance last reported again after another one
        self._reported: dict[str, dict[str, float]] = {}  # when each instance of a name last reported

    def note(self, name: str, instance: str) -> None:
        """An instance of a node reports."""
        if max(len(name), len(instance)) > LONGEST_NAME:
            return
        known = self._instances.setdefault(name, [])
        reported = self._reported.setdefault(name, {})
        reported[instance] = self._clock()
        if known and known[-1] == instance:
            return
        if instance in known:
            self._alternated[name] = self._clock()
            known.remove(instance)
        known.append(instance)
        for forgotten in known[:-KEPT_INSTANCES]:
            del reported[forgotten]
        del known[:-KEPT_INSTANCES]
        if len(self._instances) > KEPT_NAMES:
            oldest = next(iter(self._instances))
            del self._instances[oldest]
            self._alternated.pop(oldest, None)
            self._reported.pop(oldest, None)

    def lives_twice(self, name: str) -> bool:
        """Whether two instances of a node of this name run."""
        return name in self._alternated and self._clock() - self._alternated[name] < self._patience

    def instances(self, name: str) -> list[str]:
        """The instances of a node that have reported lately."""
        now = self._clock()
        return [one for one, last in self._reported.get(name, {}).items() if now - last < 2.0 * self._patience]
