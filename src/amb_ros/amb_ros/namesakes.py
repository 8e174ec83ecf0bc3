"""Detects nodes of the same name that run at the same time, from what each reports about itself."""

from __future__ import annotations

from dataclasses import dataclass, field

PATIENCE = 5  # reports of each known instance, after which one that has not reported meanwhile has ended
KEPT_INSTANCES = 4  # per name
KEPT_NAMES = 1000  # of all nodes that report
LONGEST_NAME = 300  # characters of a name or an instance; longer ones are of no node of ours


@dataclass
class _Name:
    """What the instances of a name have reported."""

    reports: int = 0
    last: dict[str, int] = field(default_factory=dict)  # number of the last report of each instance, the oldest first
    twice: bool = False

    def note(self, instance: str) -> None:
        """An instance reports."""
        self.reports += 1
        self.twice |= instance in self.last and next(reversed(self.last)) != instance
        self.last.pop(instance, None)
        oldest = self.reports - PATIENCE * (len(self.last) + 1)
        running = [item for item in self.last.items() if item[1] > oldest]
        self.last = dict([*running, (instance, self.reports)][-KEPT_INSTANCES:])
        self.twice &= len(self.last) > 1


class Namesakes:
    """Detects that two instances of a node report alternately.

    The graph alone does not show it: a killed node stays in the graph for about 20 s beside its replacement. Reports
    show it: if both instances run, the first one reports again after the second. How long one is silent is counted in
    reports of the others, since a slow machine delays those too.
    """

    def __init__(self) -> None:
        self._names: dict[str, _Name] = {}

    def note(self, name: str, instance: str) -> None:
        """An instance of a node reports."""
        if max(len(name), len(instance)) > LONGEST_NAME:
            return
        self._names.setdefault(name, _Name()).note(instance)
        if len(self._names) > KEPT_NAMES:
            del self._names[next(iter(self._names))]

    def lives_twice(self, name: str) -> bool:
        """Whether two instances of a node of this name run."""
        return name in self._names and self._names[name].twice

    def instances(self, name: str) -> list[str]:
        """The instances of a node that have reported lately: two at least if it lives twice."""
        return list(self._names[name].last) if name in self._names else []
