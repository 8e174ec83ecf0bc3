"""Telemetry in order: every step once, gaps and repetitions counted to the sample, in bounded memory."""

from __future__ import annotations

import heapq
from collections import deque
from dataclasses import dataclass, field

from amb_core.rig.link.answers import TelemetryBlock

FARTHEST = 100_000
"""Steps by which a block may be ahead of all others, ten seconds; after a longer silence the second one is taken."""


@dataclass
class TelemetryCount:
    """What arrived, in samples.

    Attributes
    ----------
    delivered, lost, doubled, late : int
        Samples passed on; never received within the wait; received twice; received after they had been given up.
    reordered : int
        Blocks that arrived after a later one and were put in order.
    implausible : int
        Blocks far ahead of all others that were dropped, since the next one did not continue them: telemetry is not
        authenticated, and one wrong step must not end a stream.
    gaps : deque of (int, int)
        The latest gaps: first step, and the step after the last one.
    """

    delivered: int = 0
    lost: int = 0
    doubled: int = 0
    late: int = 0
    reordered: int = 0
    implausible: int = 0
    gaps: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=1000))


class InOrder:
    """Passes blocks on in the order of their steps; waits for a missing one until later samples are there.

    Parameters
    ----------
    wait : int, optional
        Steps that may arrive after a missing one before it is given up.
    count : TelemetryCount, optional
        Goes on from there, after a reboot for example; its list of gaps begins anew. None to begin at zero.

    Attributes
    ----------
    count : TelemetryCount
        What arrived.
    """

    def __init__(self, wait: int = 200, count: TelemetryCount | None = None) -> None:
        self._wait, self._next, self._newest = wait, -1, -1
        self._early: list[tuple[int, int, TelemetryBlock]] = []
        self._arrivals = 0
        self._doubtful: TelemetryBlock | None = None
        self.count = count or TelemetryCount()
        self.count.gaps.clear()  # by the steps of another boot

    def add(self, block: TelemetryBlock) -> list[TelemetryBlock]:
        """Blocks that can be passed on now that this one has arrived.

        Parameters
        ----------
        block : TelemetryBlock
            Block that has arrived.

        Returns
        -------
        list of TelemetryBlock
            Blocks in the order of their steps, without gaps unless a missing block was given up.
        """
        stop = block.first_step + block.steps
        if not self._is_plausible(block):
            return []
        if self._next < 0:
            self._next = block.first_step
        if any(first == block.first_step for first, *_ in self._early):
            self.count.doubled += block.steps
            return []
        self.count.reordered += self._next <= block.first_step and stop <= self._newest
        self._newest = max(self._newest, stop)
        self._arrivals += 1
        heapq.heappush(self._early, (block.first_step, self._arrivals, block))
        return self._ready(self._wait)

    def flush(self) -> list[TelemetryBlock]:
        """All that is left at the end of a stream.

        Returns
        -------
        list of TelemetryBlock
            Blocks in the order of their steps.
        """
        return self._ready(0)

    def _is_plausible(self, block: TelemetryBlock) -> bool:
        """Whether a block is near the others, or continues one that was not: then the stream has jumped indeed."""
        doubtful, self._doubtful = self._doubtful, None
        if self._next < 0 or block.first_step <= self._newest + FARTHEST:
            self.count.implausible += doubtful is not None
            return True
        if doubtful is not None and block.first_step == doubtful.first_step + doubtful.steps:
            return True  # the gap before it is counted; it lost its first block
        self.count.implausible += doubtful is not None
        self._doubtful = block
        return False

    def _ready(self, wait: int) -> list[TelemetryBlock]:
        ready: list[TelemetryBlock] = []
        while self._early:
            first, _, block = self._early[0]
            if first > self._next:
                if self._newest - self._next <= wait:
                    break
                self.count.lost += first - self._next
                self.count.gaps.append((self._next, first))
                self._next = first
            heapq.heappop(self._early)
            fresh = self._without_known(block)
            if fresh is not None:
                ready.append(fresh)
                self.count.delivered += fresh.steps
                self._next = fresh.first_step + fresh.steps
        return ready

    def _without_known(self, block: TelemetryBlock) -> TelemetryBlock | None:
        """The part of a block that has not been passed on; the rest is counted."""
        known = min(self._next - block.first_step, block.steps)
        if known <= 0:
            return block
        stop = block.first_step + known
        late = sum(max(0, min(end, stop) - max(start, block.first_step)) for start, end in self.count.gaps)
        self.count.late += late
        self.count.doubled += known - late
        if known == block.steps:
            return None
        return block.part(known, block.steps)
