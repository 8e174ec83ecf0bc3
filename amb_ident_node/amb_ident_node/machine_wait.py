"""Messages that wait for the machine: telemetry of axes that it does not have, and what comes after. Without ROS."""

from __future__ import annotations

from typing import Any, NamedTuple

from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_ident_node.completeness import forget_oldest

MOST_STEPS = 300_000  # kept at most: half a minute of a 10 kHz loop, 30 MB of four axes
MOST_MESSAGES = 30_000  # with telemetry or without
MOST_GIVEN_UP = 1_000  # names of axes that nobody described


class Telemetry(NamedTuple):
    """A block of telemetry of a run."""

    run: int
    block: LoopRecord


class MachineWait:
    """Holds the messages of a run back until the machine with its axes is known, for a limited time.

    A loop publishes its machine before its first sample. The two come from different nodes, so that the telemetry may
    arrive first. A bag of version 0.1 has no machine: after the timeout its telemetry passes without one.

    Parameters
    ----------
    timeout : float
        Longest wait (s).

    Attributes
    ----------
    machine : Machine or None
        The last one known.
    missing : tuple of str
        Axes of the telemetry that waits; empty if none does.
    steps : int
        Steps of telemetry that wait.
    """

    def __init__(self, timeout: float) -> None:
        self.machine: Machine | None = None
        self.missing: tuple[str, ...] = ()
        self.steps = 0
        self._timeout = timeout
        self._since = 0.0
        self._held: list[Any] = []
        self._run: int | None = None  # of the last telemetry that passed
        self._given_up: dict[tuple[str, ...], None] = {}  # axes that have waited long enough

    def add(self, message: Any, now: float) -> list[Any]:
        """Take in `Telemetry` or another message at a time (s); the messages to process now, in order."""
        axes, steps = _telemetry(message)
        if not self.missing and not self._waits(message, axes):
            if axes:
                self._run = message.run
            return [message]
        if not self.missing:
            self.missing, self._since = axes, now
        self._held.append(message)
        self.steps += steps
        return self._give_up(now) if self.steps >= MOST_STEPS or len(self._held) >= MOST_MESSAGES else []

    def use(self, machine: Machine, now: float) -> list[Any]:
        """A machine has arrived; the messages to process now."""
        self.machine = machine
        self._given_up.clear()
        return self._release(now) if machine.axis_names == self.missing else []

    def expire(self, now: float) -> list[Any]:
        """The messages to process now, if they have waited long enough."""
        return self._give_up(now) if self.missing and now - self._since >= self._timeout else []

    def _waits(self, message: Any, axes: tuple[str, ...]) -> bool:
        """Whether a message is the first one of a run with axes of which no machine is known."""
        known = () if self.machine is None else self.machine.axis_names
        return bool(axes) and message.run != self._run and axes != known and axes not in self._given_up

    def _give_up(self, now: float) -> list[Any]:
        self._given_up[self.missing] = None
        forget_oldest(self._given_up, MOST_GIVEN_UP)
        return self._release(now)

    def _release(self, now: float) -> list[Any]:
        held, self._held = self._held, []
        self.missing, self.steps = (), 0
        return [passed for message in held for passed in self.add(message, now)]


def _telemetry(message: Any) -> tuple[tuple[str, ...], int]:
    """Axes and number of steps of a block of telemetry; nothing for any other message."""
    return (message.block.axes, message.block.steps) if isinstance(message, Telemetry) else ((), 0)
