"""A recording in progress: a thread of its own writes the bag, behind a queue. Thread-safe, without ROS.

So a disk that stalls holds up neither the callbacks of the node nor the queues of DDS.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

from amb_core.ground.errors import BagError
from amb_core.recording import BagWriter
from amb_core.recording.messages.parameters import ParameterValue
from amb_ident_node.completeness import Mark
from amb_ident_node.message_queue import Loss, MessageQueue, Waiting, describe_losses

CAPACITY = 200e6  # B


class BagInProgress:
    """A bag being recorded. Messages wait until the beginning of the recording is known.

    Parameters
    ----------
    writer : BagWriter
        The bag, with its topics added. From `begin` on it is used by the thread alone.
    flush_period : float, optional
        Longest time between two flushes (s).
    capacity : float, optional
        Largest size of the queue (B).
    essential : collection of str, optional
        Topics whose messages are dropped last.
    check : callable, optional
        Called before each flush; the recording ends if it raises a `BagError`.

    Attributes
    ----------
    failure : str
        Why the recording ended before `end`; empty if it did not.
    ended : bool
        Whether `end` was called.
    """

    def __init__(
        self,
        writer: BagWriter,
        flush_period: float = 0.5,
        capacity: float = CAPACITY,
        essential: Collection[str] = (),
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self.failure = ""
        self._writer = writer
        self._flush_period = flush_period
        self._capacity = capacity
        self._check = check
        self._origin: Mark | None = None
        self._queue = MessageQueue(capacity, essential)
        self._unsaved: list[Waiting] = []  # taken from the queue, and not on the disk yet
        self._accepted = self._taken = self._saved = 0  # messages
        self._flush_up_to = 0  # number of the message that a caller wants on the disk
        self.ended = self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)

    @property
    def folder(self) -> Path:
        """Folder of the bag."""
        return self._writer.folder

    @property
    def messages(self) -> int:
        """Number of messages in the bag, without those that wait for the disk."""
        return self._writer.saved if self.failure else self._writer.messages

    @property
    def queued(self) -> tuple[int, int]:
        """Number of messages that wait for the disk, and the memory that they take (B)."""
        with self._changed:
            return len(self._queue), self._queue.size

    @property
    def dropped(self) -> dict[str, Loss]:
        """Messages that belong to the recording and are not in the bag, by topic."""
        with self._changed:
            return {topic: replace(loss) for topic, loss in self._queue.dropped.items()}

    @property
    def trouble(self) -> str:
        """Which messages are not in the bag, and why; empty if all are."""
        losses = describe_losses(self.dropped)
        if self.failure:
            return self.failure + (f"; not in the bag: {losses}" if losses else "")
        if losses:
            return f"the disk is too slow, and the queue of {self._capacity / 1e6:g} MB was full: dropped {losses}"
        return ""

    def begin(self, origin: Mark | None, first: Mapping[str, bytes]) -> None:
        """Begin at a place in a run (None if unknown), with the current states of some topics."""
        with self._changed:
            self._origin = origin
            came = {(message.topic, message.data) for message in self._queue}
            held = [message for message in self._queue if not self._is_older(message.end)]
            began = held[0].received if held else time.time_ns()
            # A current state that has just arrived is not written twice.
            states = [Waiting(topic, data, began) for topic, data in first.items() if (topic, data) not in came]
            self._queue.replace([*states, *held])
            self._accepted = len(self._queue)
        self._thread.start()

    def write(self, topic: str, data: bytes, end: Mark | None = None, steps: int = 0) -> bool:
        """Append a message as received; it is left out if it ends before the recording begins.

        Parameters
        ----------
        topic, data
            The message, serialized.
        end : Mark, optional
            Where in a run it ends.
        steps : int, optional
            Number of samples of the loop in it, to count them if the message is lost.

        Returns
        -------
        bool
            False if the message belongs to the recording but is lost: the queue is full, or the recording has failed.
        """
        with self._changed:
            if self.ended or self._is_older(end):
                return True
            message = Waiting(topic, data, time.time_ns(), end, steps)
            if self.failure:
                self._queue.drop(message)
                return False
            accepted = self._queue.put(message)
            self._accepted += accepted
            self._changed.notify_all()
            return accepted

    def write_parameters(self, topic: str, node: str, values: Mapping[str, ParameterValue]) -> None:
        """Append the parameters of a node."""
        self.write(topic, self._writer.parameter_event(node, values, time.time_ns()))

    def flush(self) -> None:
        """Wait until everything so far is on the disk, or the recording has failed."""
        with self._changed:
            self._flush_up_to = wanted = self._accepted
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._saved >= wanted or self._closed)

    def end(self) -> None:
        """Take no further message; what waits is written, then the bag is closed."""
        if self._thread.ident is None:  # ended before its beginning was known
            self.begin(None, {})
        with self._changed:
            self.ended = True
            self._changed.notify_all()

    def close(self) -> None:
        """End, and wait until the bag is closed; a second call does nothing. See `trouble` for what went wrong."""
        self.end()
        self._thread.join()

    def discard(self) -> None:
        """Close and remove the bag; errors of the disk are ignored."""
        self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _is_older(self, end: Mark | None) -> bool:
        """Whether a message that ends there belongs to an earlier run, or to steps before the recording."""
        if end is None or self._origin is None:
            return False
        return (end.run, end.step) <= (self._origin.run, self._origin.step)

    # -- in the thread

    def _run(self) -> None:
        for action in (self._write_all, self._writer.close):
            try:
                action()
            except BagError as problem:
                self._fail(str(problem))
            except Exception as problem:  # whatever it is, the node must learn that nothing is written any more
                self._fail(f"bag {self.folder}: internal error: {problem!r}")
        with self._changed:
            self._note_saved()
            for message in self._unsaved:
                self._queue.drop(message)
            self._queue.drop_all()
            self._closed = True
            self._changed.notify_all()

    def _write_all(self) -> None:
        """Write what comes until the end, and flush now and then."""
        due = time.monotonic() + self._flush_period
        while True:
            message, is_last = self._next(due)
            if message is not None:
                self._unsaved.append(message)
                self._taken += 1
                self._writer.write(message.topic, message.data, message.received)
            if is_last:
                return
            if time.monotonic() >= due or self._saved < self._flush_up_to <= self._taken:
                self._check()
                self._writer.flush()
                due = time.monotonic() + self._flush_period
            with self._changed:
                self._note_saved()
                self._changed.notify_all()

    def _next(self, due: float) -> tuple[Waiting | None, bool]:
        """The next message, None if there is none before a time; and whether the recording has ended without one."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._queue or self.ended or self._saved < self._flush_up_to <= self._taken,
                max(due - time.monotonic(), 0.0),
            )
            message = self._queue.pop() if self._queue else None
            return message, message is None and self.ended

    def _note_saved(self) -> None:
        """Forget the messages that are on the disk."""
        self._saved = self._writer.saved
        del self._unsaved[: len(self._unsaved) - (self._taken - self._saved)]

    def _fail(self, reason: str) -> None:
        with self._changed:
            self.failure = self.failure or reason


def require_free_space(folder: Path, minimum: float) -> None:
    """Refuse a bag on a disk that is full or almost full.

    Raises
    ------
    BagError
        If less than `minimum` bytes are free.
    """
    # Path.is_dir raises on a name that is too long; the writer of the bag refuses that.
    there = next((parent for parent in folder.absolute().parents if os.path.isdir(parent)), Path("/"))  # noqa: PTH112
    free = shutil.disk_usage(there).free
    if free < minimum:
        raise BagError(
            f"bag {folder.absolute()}: {free / 1e6:.1f} MB are free on its disk; allowed: {minimum / 1e6:g} MB or more "
            "(parameter minimum_free_space)"
        )
