"""A recording in progress: the bag, its beginning and its failure. Thread-safe, without ROS."""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from amb_core.errors import BagError
from amb_core.recording import BagWriter
from amb_core.recording.messages.parameters import ParameterValue
from amb_ident_node.completeness import Mark


class BagInProgress:
    """A bag being recorded. Messages are buffered until the beginning of the recording is known.

    Parameters
    ----------
    writer : BagWriter
        The bag, with its topics added.
    """

    def __init__(self, writer: BagWriter) -> None:
        self._writer = writer
        self._origin: Mark | None = None
        self._held: list[tuple[str, bytes, Mark | None, int]] | None = []
        self._lock = threading.Lock()
        self._closed = False
        self.failure = ""

    @property
    def folder(self) -> Path:
        """Folder of the bag."""
        return self._writer.folder

    @property
    def messages(self) -> int:
        """Number of messages in the bag."""
        return self._writer.messages

    def begin(self, origin: Mark | None, first: Mapping[str, bytes]) -> None:
        """Begin at a place in a run (None if unknown), with the current states of some topics."""
        with self._lock:
            self._origin = origin
            held, self._held = self._held or [], None
            came = {(topic, data) for topic, data, _, _ in held}
            for topic, data in first.items():
                if (topic, data) not in came:  # a current state that has just arrived is not written twice
                    self._write(topic, data, time.time_ns())
            for topic, data, end, received in held:
                if not self._is_older(end):
                    self._write(topic, data, received)

    def write(self, topic: str, data: bytes, end: Mark | None = None) -> None:
        """Append a message as received; it is left out if it ends before the recording begins.

        The first failure ends the recording and is kept in `failure`.
        """
        with self._lock:
            if self._held is not None:
                self._held.append((topic, data, end, time.time_ns()))
            elif not self._is_older(end):
                self._write(topic, data, time.time_ns())

    def write_parameters(self, topic: str, node: str, values: Mapping[str, ParameterValue]) -> None:
        """Append the parameters of a node."""
        with self._lock:
            self._attempt(lambda: self._writer.write_parameters(topic, node, values, time.time_ns()))

    def flush(self) -> None:
        """Write the chunk in progress to the disk."""
        with self._lock:
            self._attempt(self._writer.flush)

    def close(self) -> None:
        """Close the bag; a second call does nothing.

        Raises
        ------
        BagError
            If the bag cannot be completed.
        """
        if self._held is not None:  # ended before its beginning was known
            self.begin(None, {})
        with self._lock:
            if not self._closed:
                self._closed = True
                self._writer.close()

    def discard(self) -> None:
        """Close and remove the bag; errors of the disk are ignored."""
        with contextlib.suppress(BagError):
            self.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _is_older(self, end: Mark | None) -> bool:
        """Whether a message that ends there belongs to an earlier run, or to steps before the recording."""
        if end is None or self._origin is None:
            return False
        return (end.run, end.step) <= (self._origin.run, self._origin.step)

    def _write(self, topic: str, data: bytes, received: int) -> None:
        self._attempt(lambda: self._writer.write(topic, data, received))

    def _attempt(self, action: Callable[[], None]) -> None:
        if self._closed or self.failure:
            return
        try:
            action()
        except BagError as problem:
            self.failure = str(problem)


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
