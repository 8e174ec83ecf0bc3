"""Writes one MCAP file (https://mcap.dev/spec), chunk by chunk, and knows which messages are not in the file yet."""

from __future__ import annotations

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mcap.writer import Writer

from amb_core.ground.version import __version__

PROGRAM = f"amb_core {__version__}"
"""What a bag names as its writer."""

CHUNK_SIZE = 1 << 20
"""Bytes after which a chunk is written. The index of a chunk stays in memory until the file is closed."""


@dataclass(frozen=True)
class StoredTopic:
    """A topic as a file describes it.

    Attributes
    ----------
    name : str
        Full topic name.
    type : str
        As `package/msg/Name`.
    encoding : str
        Format of the definition, `ros2msg` or `ros2idl`.
    definition : bytes
        Definition of the type, followed by those of the types it uses.
    serialization : str
        Format of its messages.
    metadata : mapping of str to str
        What rosbag2 stores of a topic: `offered_qos_profiles` (YAML) and `topic_type_hash`.
    """

    name: str
    type: str
    encoding: str
    definition: bytes
    serialization: str = "cdr"
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str]:
        """Name and type."""
        return self.name, self.type


@dataclass
class FileContent:
    """What a file holds, that of the chunk in progress included.

    Attributes
    ----------
    path : Path
        The file.
    counts : Counter of (str, str)
        Messages by name and type of the topic.
    start, end : int
        Earliest and latest time of a message (ns since 1970).
    """

    path: Path
    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    start: int = 2**63 - 1
    end: int = 0


class McapFile:
    """An MCAP file being written. Whatever fails raises an `OSError`, and from then on everything fails.

    Parameters
    ----------
    path : Path
        The file; must not exist.

    Attributes
    ----------
    content : FileContent
        What it holds.
    pending : int
        Number of messages in the chunk in progress.
    """

    def __init__(self, path: Path) -> None:
        self.content = FileContent(path)
        self.pending = 0
        self._pending_size = 0
        self._problem: OSError | None = None
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._stream = path.open("xb")
        self._writer = Writer(self._stream, chunk_size=sys.maxsize)  # `write` decides where a chunk ends
        self._writer.start(profile="ros2", library=PROGRAM)

    @property
    def size(self) -> int:
        """Size of the file without the chunk in progress (B)."""
        return self._stream.tell()

    def add_topic(self, topic: StoredTopic) -> None:
        """Add a topic before its first message."""
        schema = (topic.type, topic.encoding, topic.definition)
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(*schema)
        self._channels[topic.key] = self._writer.register_channel(
            topic.name, topic.serialization, self._schemas[schema], dict(topic.metadata)
        )

    def write(self, topic: StoredTopic, data: bytes, log_time: int, publish_time: int, sequence: int = 0) -> None:
        """Append a message; times in ns since 1970."""
        self._writer.add_message(self._channels[topic.key], log_time, data, publish_time, sequence)
        self.pending += 1
        content = self.content
        content.counts[topic.key] += 1
        content.start, content.end = min(content.start, log_time), max(content.end, log_time)
        self._pending_size += len(data)
        if self._pending_size >= CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write the chunk in progress."""
        self._attempt(self._writer.flush)
        self.pending = self._pending_size = 0

    def close(self) -> None:
        """Write the rest and the index, and close the file. It is closed even if that fails."""
        try:
            self.flush()
            self._attempt(self._finish)
        finally:
            with contextlib.suppress(OSError):
                self._stream.close()

    def _finish(self) -> None:
        self._writer.finish()
        self._stream.close()

    def _attempt(self, action: Callable[[], None]) -> None:
        """Do something that may fail, but nothing after a failure: it would follow half a chunk."""
        if self._problem is not None:
            raise self._problem
        try:
            action()
        except OSError as problem:
            self._problem = problem
            raise
