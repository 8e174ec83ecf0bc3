"""Nodes that a recording depends on, and which of them died while it went on. Thread-safe, without ROS.

A killed node stays in the graph for about 20 s, so its reports decide: each node of the workbench reports every 0.5 s.
Silence is counted in periods of the recorder's own timer. On a busy machine these grow as those of the others do, and a
recorder that was itself held up does not take its own silence for theirs.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

PATIENCE = 8  # periods of 0.5 s without a sign of life after which a node is taken to have died
KEPT_NODES = 100  # that are needed
KEPT_ENDS = 3  # of a node within runs


@dataclass
class _Node:
    topics: frozenset[str] = frozenset()
    reports: bool = False  # a node of others may publish its topics without
    instance: str = ""
    silent: int = 0  # periods
    signs: int = 0  # of life
    seen: str = ""  # time of the last one
    replaced: dict[str, None] = field(default_factory=dict)  # times at which another process took its place in a run


class Departures:
    """The nodes that publish the topics of a run."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._nodes: dict[str, _Node] = {}
        self._ended = False

    def start(self) -> None:
        """A recording starts: forget nodes that left before."""
        with self._changed:
            self._nodes = {name: node for name, node in self._nodes.items() if node.silent < PATIENCE}
            for node in self._nodes.values():
                node.replaced.clear()

    def note_period(self, publishers: Mapping[str, Collection[str]], now: str, within_run: bool) -> None:
        """A period of the recorder's timer has passed. Between runs, nodes that have left the graph are forgotten.

        Parameters
        ----------
        publishers : mapping of str to collection of str
            The topics of a run that each node publishes, as far as the recorder knows.
        now : str
            Wall-clock time as text.
        within_run : bool
            Whether a run is in progress.
        """
        with self._changed:
            for name, topics in publishers.items():
                if len(self._nodes) < KEPT_NODES:
                    self._nodes.setdefault(name, _Node())
                if name in self._nodes:
                    self._nodes[name].topics |= frozenset(topics)
            for name, node in self._nodes.items():
                node.silent += 1
                if not node.reports and name in publishers:
                    self._note_sign(node, now)
            if not within_run:
                self._nodes = {
                    name: node
                    for name, node in self._nodes.items()
                    if name in publishers or node.silent < PATIENCE or node.replaced
                }
            self._changed.notify_all()

    def note_report(self, name: str, instance: str, now: str, within_run: bool) -> None:
        """A process reports as a node, while a run is or is not in progress."""
        with self._changed:
            node = self._nodes.get(name)
            if node is None:
                return
            if within_run and node.instance not in ("", instance) and len(node.replaced) < KEPT_ENDS:
                node.replaced[node.seen] = None
            node.reports, node.instance = True, instance
            self._note_sign(node, now)
            self._changed.notify_all()

    def wait_for_signs(self) -> None:
        """Wait until each node has given a sign of life from now on, or has been silent for too long."""
        with self._changed:
            before = {name: node.signs for name, node in self._nodes.items()}
            self._changed.wait_for(
                lambda: (
                    self._ended
                    or all(
                        node.signs > before.get(name, 0) or node.silent >= PATIENCE
                        for name, node in self._nodes.items()
                    )
                )
            )

    def end(self) -> None:
        """Release all waiting threads."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def died(self, within_run: bool = True) -> list[str]:
        """The nodes that have died, one text each; those that are silent only while a run is in progress."""
        with self._changed:
            texts = []
            for name, node in sorted(self._nodes.items()):
                topics = f"it published {', '.join(sorted(node.topics))}"
                texts += [f"{name} ended within a run, last seen at {time}; {topics}" for time in node.replaced]
                if within_run and node.silent >= PATIENCE:
                    texts.append(f"{name} died or hangs, last seen at {node.seen}; {topics}")
            return texts

    def _note_sign(self, node: _Node, now: str) -> None:
        node.silent, node.seen = 0, now
        node.signs += 1
