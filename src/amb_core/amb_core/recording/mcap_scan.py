"""Reads an MCAP file from its beginning, so that its end may be missing, and over chunks that are damaged."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, BinaryIO, cast

import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from amb_core.errors import BagError
from amb_core.files.regular_files import open_regular
from amb_core.recording.mcap_file import StoredTopic

LARGEST = 1 << 30
"""Largest record or chunk that is read (B): a corrupt length must not take all memory."""
UNREADABLE = (
    McapError,
    ValueError,
    LookupError,
    OverflowError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    MemoryError,
)
"""What reader, checksums and decompressors (lz4: RuntimeError) raise for incomplete data."""


class NotMcapError(BagError):
    """The file is of another kind."""


class McapScan:
    """One MCAP file, read once by `messages`.

    Attributes
    ----------
    path : Path
        The file.
    size : int
        Its size (B).
    position : int
        How far it was read (B).
    topics : dict of (str, str) to StoredTopic
        Its topics by name and type, as far as it was read.
    damage : list of str
        What cannot be read, one text each; empty for a whole file. Known at the end of `messages`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = self.position = 0
        self.topics: dict[tuple[str, str], StoredTopic] = {}
        self.damage: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, StoredTopic] = {}
        self._is_data_whole = self._is_index_read = False

    def messages(self) -> Iterator[tuple[StoredTopic, Message]]:
        """All messages that can be read, in order.

        Raises
        ------
        BagError
            If it is not an MCAP file, or cannot be opened.
        """
        try:
            with open_regular(self.path) as stream:
                self.size = self.path.stat().st_size
                if not MCAP0_MAGIC.startswith(stream.read(len(MCAP0_MAGIC))):
                    raise NotMcapError(f"bag {self.path}: not an MCAP file")
                stream.seek(0)
                bounded = cast("IO[bytes]", _BoundedReads(stream))
                reader = StreamReader(bounded, emit_chunks=True, record_size_limit=min(self.size, LARGEST))
                for record in self._top_level(reader):
                    yield from self._messages_in(record)
                    self.position = stream.tell()
        except OSError as problem:
            raise BagError(f"bag {self.path}: cannot be read: {problem.strerror}") from None

    def _top_level(self, reader: StreamReader) -> Iterator[McapRecord]:
        is_closed = False
        try:
            for record in reader.records:
                self._is_data_whole |= isinstance(record, DataEnd)
                is_closed |= isinstance(record, Footer)
                yield record
        except UNREADABLE:
            is_closed = False
        if not is_closed:
            self.damage.append(self._missing_end())

    def _messages_in(self, record: McapRecord) -> Iterator[tuple[StoredTopic, Message]]:
        try:
            records = self._unpacked(record) if isinstance(record, Chunk) else [record]
            messages = []
            for item in records:
                if isinstance(item, Message):
                    messages.append((self._topic_of(item), item))
                else:
                    self._learn(item)
        except UNREADABLE:
            what = "chunk" if isinstance(record, Chunk) else "record"
            self.damage.append(f"{self.path.name} is damaged: the {what} at byte {self.position} cannot be read")
            return
        yield from messages

    def _unpacked(self, chunk: Chunk) -> list[McapRecord]:
        if chunk.uncompressed_size > LARGEST:
            raise ValueError("too large")
        return breakup_chunk(chunk, validate_crc=True)

    def _topic_of(self, message: Message) -> StoredTopic:
        if message.channel_id not in self._channels and not self._is_index_read:
            self._read_index()
        return self._channels[message.channel_id]

    def _read_index(self) -> None:
        """Learn the topics from the end of the file, because the chunk that introduces them is damaged."""
        self._is_index_read = True
        with open_regular(self.path) as stream, contextlib.suppress(*UNREADABLE):
            summary = SeekingReader(stream, record_size_limit=LARGEST).get_summary()
            for record in (*summary.schemas.values(), *summary.channels.values()) if summary else ():
                self._learn(record)

    def _learn(self, record: McapRecord) -> None:
        """Note a topic or its definition."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            schema = self._schemas[record.schema_id]
            topic = StoredTopic(
                record.topic, schema.name, schema.encoding, schema.data, record.message_encoding, record.metadata
            )
            self._channels[record.id] = self.topics.setdefault(topic.key, topic)

    def _missing_end(self) -> str:
        if self._is_data_whole:
            return f"{self.path.name} is incomplete: it lacks its index, but no message"
        lost = self.size - self.position
        return f"{self.path.name} is incomplete: it was not closed, and its last {lost} of {self.size} bytes are lost"


class _BoundedReads:
    """A stream of which no more than `LARGEST` is read at a time: lengths inside a record may be corrupt too."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def read(self, length: int) -> bytes:
        if length > LARGEST:
            raise ValueError(f"{length} bytes are too many")
        return self._stream.read(length)
