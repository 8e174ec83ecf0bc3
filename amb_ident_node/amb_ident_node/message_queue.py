"""The messages that wait for the disk: a queue of bounded size that counts what does not fit. Without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from amb_ident_node.completeness import Mark

OVERHEAD = 500
"""Memory that a waiting message takes in addition to its data (B)."""
STREAMS, RESUMING = 0.9, 0.5  # of the capacity


class Waiting(NamedTuple):
    """A message that waits.

    Attributes
    ----------
    topic : str
        Its topic.
    data : bytes
        As received.
    received : int
        When (ns since 1970).
    end : Mark or None
        Where in a run it ends; None if that does not decide whether it belongs to the recording.
    steps : int
        Number of samples of the loop in it.
    """

    topic: str
    data: bytes
    received: int
    end: Mark | None = None
    steps: int = 0

    @property
    def size(self) -> int:
        """Memory that it takes (B)."""
        return len(self.data) + OVERHEAD


@dataclass
class Loss:
    """Messages of a topic that are not in the bag, and the samples of the loop in them."""

    messages: int = 0
    steps: int = 0


class MessageQueue:
    """Messages in order of arrival.

    Streams get nine tenths of it. When these are full, streams are dropped until half of the queue is empty: one long
    gap is better data than many short ones. The rest is for messages that are few and explain all others.

    Parameters
    ----------
    capacity : float
        Largest size (B).
    essential : collection of str
        Topics that may use all of it.

    Attributes
    ----------
    size : int
        Its present size (B).
    dropped : dict of str to Loss
        What was dropped, by topic.
    """

    def __init__(self, capacity: float, essential: Collection[str] = ()) -> None:
        self.size = 0
        self.dropped: dict[str, Loss] = {}
        self._capacity = capacity
        self._essential = essential
        self._waiting: deque[Waiting] = deque()
        self._is_overflowing = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: Waiting) -> bool:
        """Append a message, or drop it if it does not fit; whether it was appended."""
        size = self.size + message.size
        if self._is_overflowing and size <= RESUMING * self._capacity:
            self._is_overflowing = False
        if message.topic in self._essential:
            fits = size <= self._capacity
        else:
            fits = not self._is_overflowing and size <= STREAMS * self._capacity
            self._is_overflowing = not fits
        if fits:
            self._waiting.append(message)
            self.size = size
        else:
            self.drop(message)
        return fits

    def pop(self) -> Waiting:
        """The first message."""
        message = self._waiting.popleft()
        self.size -= message.size
        return message

    def drop(self, message: Waiting) -> None:
        """Count a message that is not in the bag."""
        loss = self.dropped.setdefault(message.topic, Loss())
        loss.messages += 1
        loss.steps += message.steps

    def drop_all(self) -> None:
        """Drop all that wait."""
        while self._waiting:
            self.drop(self.pop())

    def replace(self, messages: Iterable[Waiting]) -> None:
        """Let these messages wait instead of the present ones, whatever their size."""
        self._waiting = deque(messages)
        self.size = sum(message.size for message in self._waiting)

    def __iter__(self) -> Iterator[Waiting]:
        return iter(self._waiting)


def describe_losses(dropped: Mapping[str, Loss]) -> str:
    """Dropped messages as text, such as `12 messages of /amb/telemetry (1200 steps), 3 messages of /clock`."""
    texts = [
        f"{loss.messages} messages of {topic}" + (f" ({loss.steps} steps)" if loss.steps else "")
        for topic, loss in sorted(dropped.items())
    ]
    return ", ".join(texts)
