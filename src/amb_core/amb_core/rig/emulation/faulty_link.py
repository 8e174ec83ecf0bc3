"""A network that loses, repeats, reorders, corrupts and delays frames, and counts what it does to the sample."""

from __future__ import annotations

import heapq
import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from amb_core.rig.emulation.parameters import LinkFaults
from amb_core.rig.link import FrameType, Peer
from amb_core.rig.link.layout import HEADER

HOLD = 0.05  # s; a frame that waits for the next one is passed on after this time at the latest
_ROWS = HEADER.size + 4  # where a telemetry frame has its number of samples
_REMEMBERED = 1000  # frames with copies; more than there are on the way


class UndeliveredSamples(NamedTuple):
    """Samples of telemetry that were not delivered.

    Attributes
    ----------
    session : int
        Session of the target.
    first : int
        First step.
    stop : int
        Step after the last one.
    """

    session: int
    first: int
    stop: int


@dataclass
class LinkCount:
    """What became of the frames of one direction.

    Attributes
    ----------
    frames : int
        Frames that were sent.
    lost, doubled, reordered, corrupted : int
        Those of them that met these faults.
    samples : int
        Samples of telemetry that were lost or corrupted, and so not delivered.
    gaps : deque of UndeliveredSamples
        The latest of these, those that follow each other as one. What is delivered later than a receiver waits for it
        is not among them: the receiver counts it as lost, then as late.
    """

    frames: int = 0
    lost: int = 0
    doubled: int = 0
    reordered: int = 0
    corrupted: int = 0
    samples: int = 0
    gaps: deque[UndeliveredSamples] = field(default_factory=lambda: deque(maxlen=10_000))


class FaultyLink:
    """One direction of the network between target and host. Times are those of the caller's clock (s).

    Parameters
    ----------
    faults : LinkFaults
        Its faults; may be replaced at any time.
    seed : sequence of int
        Of the random decisions.

    Attributes
    ----------
    count : LinkCount
        What became of the frames.
    """

    def __init__(self, faults: LinkFaults, seed: tuple[int, ...]) -> None:
        self.count = LinkCount()
        self._waiting: list[tuple[float, int, bytes, Peer]] = []  # due time, order
        self._held: list[tuple[float, bytes, Peer]] = []  # time of release, those that the next frame overtakes
        self._order = 0
        self._copies: dict[bytes, int] = {}  # of the latest frames that are doubled or corrupted: right ones on the way
        self.restart(seed)
        self.configure(faults)

    def configure(self, faults: LinkFaults) -> None:
        """Use other faults from now on.

        Parameters
        ----------
        faults : LinkFaults
            The new faults.
        """
        self._faults, self._none = faults, faults.none

    def restart(self, seed: tuple[int, ...]) -> None:
        """Begin the random decisions anew.

        Parameters
        ----------
        seed : tuple of int
            Of the random decisions.
        """
        self._generator = np.random.default_rng(seed)

    def send(self, frame: bytes, peer: Peer, now: float) -> None:
        """Put a frame into the network.

        Parameters
        ----------
        frame : bytes
            The frame.
        peer : Peer
            Its receiver, or its sender on the way to the target.
        now : float
            Time of the caller's clock (s).
        """
        self.count.frames += 1
        if self._none:
            self._pass_on(frame, peer, now)
            return
        faults = self._faults
        lost, doubled, held, corrupted, bit, *further = self._generator.random(7).tolist()
        if lost < faults.loss:
            self.count.lost += 1
            self._count_samples(frame)
            return
        if corrupted < faults.corruption:
            self.count.corrupted += 1
            self._count_samples(frame)
            frame = _with_wrong_bit(frame, bit)
            self._remember(frame, 0)
        due, due_again = (now + faults.delay + faults.delay_jitter * share for share in further)
        if doubled < faults.duplication:
            self.count.doubled += 1
            if corrupted >= faults.corruption:
                self._remember(frame, 2)
            self._pass_on(frame, peer, due_again)
        if held < faults.reordering:
            self._held.append((due + HOLD, frame, peer))
        else:
            self._pass_on(frame, peer, due)

    def received(self, now: float) -> list[tuple[bytes, Peer]]:
        """Frames that come out of the network up to now, in their order.

        Parameters
        ----------
        now : float
            Time of the caller's clock (s).

        Returns
        -------
        list of (bytes, Peer)
            The frames with their receivers.
        """
        for release, frame, peer in self._held:
            if release <= now:
                self._wait(frame, peer, release)
        self._held = [held for held in self._held if held[0] > now]
        out = []
        while self._waiting and self._waiting[0][0] <= now:
            _, _, frame, peer = heapq.heappop(self._waiting)
            out.append((frame, peer))
        return out

    def flush(self) -> list[tuple[bytes, Peer]]:
        """All frames that are still in the network.

        Returns
        -------
        list of (bytes, Peer)
            The frames with their receivers, in their order.
        """
        return self.received(math.inf)

    def _pass_on(self, frame: bytes, peer: Peer, due: float) -> None:
        """Let a frame come out when it is due, and after it those that it overtakes."""
        self._wait(frame, peer, due)
        for _, earlier, its_peer in self._held:
            self.count.reordered += 1
            self._wait(earlier, its_peer, due)
        self._held.clear()

    def _wait(self, frame: bytes, peer: Peer, due: float) -> None:
        self._order += 1
        heapq.heappush(self._waiting, (due, self._order, frame, peer))

    def _remember(self, frame: bytes, copies: int) -> None:
        self._copies[frame] = copies
        if len(self._copies) > _REMEMBERED:
            del self._copies[next(iter(self._copies))]

    def not_delivered(self, frame: bytes) -> None:
        """Count the samples of a frame that came out of the network in vain, unless a copy of it still comes or came.

        Parameters
        ----------
        frame : bytes
            Any frame of the target.
        """
        left = self._copies.get(frame, 1) - 1
        if left > 0:
            self._copies[frame] = left
        elif left == 0:
            self._count_samples(frame)

    def _count_samples(self, frame: bytes) -> None:
        """Count the samples of a frame as not delivered, if it is one of telemetry."""
        if len(frame) < _ROWS + 2:
            return
        _, _, kind, _, session, _, first = HEADER.unpack_from(frame)
        if kind != FrameType.TELEMETRY:
            return
        stop = first + int.from_bytes(frame[_ROWS : _ROWS + 2], "little")
        self.count.samples += stop - first
        gaps = self.count.gaps
        if gaps and gaps[-1].session == session and gaps[-1].stop == first:
            first = gaps.pop().first
        gaps.append(UndeliveredSamples(session, first, stop))


def _with_wrong_bit(frame: bytes, place: float) -> bytes:
    """A frame with the bit at a place, from 0 to 1, inverted."""
    byte, bit = divmod(int(place * len(frame) * 8), 8)
    return frame[:byte] + bytes([frame[byte] ^ 1 << bit]) + frame[byte + 1 :]
