"""Reads an MCAP file from its beginning, so that its end may be missing, and over chunks that are damaged."""

from __future__ import annotations

import contextlib
import os
import struct
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO, BinaryIO, cast

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from amb_core.ground.errors import BagError
from amb_core.ground.files.limits import Expansion, limits_for
from amb_core.ground.files.regular_files import MIB, open_regular
from amb_core.recording.mcap_file import StoredTopic

LARGEST = 1 << 30
"""Largest record that is read (B): a corrupt length must not take all memory."""
LARGEST_OF_SMALL = 64 * MIB
"""Largest content of a chunk in a small file (B); in others four times the size of the file."""
_LARGEST_WINDOW = 128 * MIB  # of Zstandard's decompressor, which allocates it
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

    Parameters
    ----------
    path : Path
        The file.
    content : bytes, optional
        Its content, if the file itself is compressed.

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

    def __init__(self, path: Path, content: bytes | None = None) -> None:
        self.path = path
        self._content = content
        self._expansion = Expansion(limits_for(path).expanded)
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
            with self._open() as stream:
                self.size = stream.seek(0, os.SEEK_END)
                stream.seek(0)
                if not MCAP0_MAGIC.startswith(stream.read(len(MCAP0_MAGIC))):
                    raise NotMcapError(f"bag {self.path}: not an MCAP file")
                stream.seek(0)
                bounded = cast("IO[bytes]", _BoundedReads(stream, min(self.size, LARGEST)))
                reader = StreamReader(bounded, emit_chunks=True, record_size_limit=min(self.size, LARGEST))
                for record in self._top_level(reader):
                    yield from self._messages_in(record)
                    self.position = stream.tell()
        except OSError as problem:
            raise BagError(f"bag {self.path}: cannot be read: {problem.strerror}") from None

    def indexed(self) -> list[tuple[ChunkIndex, set[tuple[str, str]]]]:
        """Chunks in order with the names and types of their topics, from the index; none where it does not hold all.

        Raises
        ------
        BagError
            If the file cannot be opened.
        """
        try:
            with self._open() as stream, contextlib.suppress(*UNREADABLE):
                self.size = stream.seek(0, os.SEEK_END)
                stream.seek(0)
                summary = SeekingReader(stream, record_size_limit=min(self.size, LARGEST)).get_summary()
                if summary is None or summary.statistics is None:
                    return []
                for record in (*summary.schemas.values(), *summary.channels.values()):
                    self._learn(record)
                chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
                keys = [{self._channels[channel].key for channel in chunk.message_index_offsets} for chunk in chunks]
                if len(chunks) == summary.statistics.chunk_count and all(keys):
                    return list(zip(chunks, keys, strict=True))
        except OSError as problem:
            raise BagError(f"bag {self.path}: cannot be read: {problem.strerror}") from None
        return []

    def messages_at(self, chunk: ChunkIndex) -> list[tuple[StoredTopic, Message]]:
        """The messages of one chunk; errors as for `messages`, damage as there."""
        try:
            with self._open() as stream:
                self.position = stream.seek(chunk.chunk_start_offset)
                bounded = cast("IO[bytes]", _BoundedReads(stream, min(self.size, LARGEST)))
                reader = StreamReader(
                    bounded, skip_magic=True, emit_chunks=True, record_size_limit=min(self.size, LARGEST)
                )
                return list(self._messages_in(next(iter(reader.records))))
        except UNREADABLE:
            self.damage.append(f"{self.path.name} is damaged: the chunk at byte {self.position} cannot be read")
        except OSError as problem:
            raise BagError(f"bag {self.path}: cannot be read: {problem.strerror}") from None
        return []

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

    def _open(self) -> BinaryIO:
        return open_regular(self.path) if self._content is None else BytesIO(self._content)

    def _unpacked(self, chunk: Chunk) -> list[McapRecord]:
        size = len(chunk.data) if not chunk.compression else chunk.uncompressed_size
        if size > min(max(LARGEST_OF_SMALL, 4 * self.size), LARGEST):
            raise ValueError("too large")
        self._expansion.take(size)
        return breakup_chunk(replace(chunk, data=_expanded(chunk), compression=""), validate_crc=True)

    def _topic_of(self, message: Message) -> StoredTopic:
        if message.channel_id not in self._channels and not self._is_index_read:
            self._read_index()
        return self._channels[message.channel_id]

    def _read_index(self) -> None:
        """Learn the topics from the end of the file, because the chunk that introduces them is damaged."""
        self._is_index_read = True
        with self._open() as stream, contextlib.suppress(*UNREADABLE):
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


def _expanded(chunk: Chunk) -> bytes:
    """The content of a chunk; no more than it declares, whatever its compressed data say."""
    if chunk.compression == "zstd":
        return expand_zstd(chunk.data, chunk.uncompressed_size)
    if chunk.compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, chunk.uncompressed_size))
    if chunk.compression:
        raise ValueError(f"compression {chunk.compression} is not known")
    return bytes(chunk.data)


def expand_zstd(data: bytes, limit: int) -> bytes:
    """Zstandard data decompressed; ValueError if that is more than a limit (B)."""
    reader = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(data, read_across_frames=True)
    parts, size = [], 0
    while part := reader.read(MIB):
        size += len(part)
        if size > limit:
            raise ValueError(f"expands to more than {limit} bytes")
        parts.append(part)
    return b"".join(parts)


class _BoundedReads:
    """A stream of which no more than a limit is read at a time: lengths inside a record may be corrupt too."""

    def __init__(self, stream: BinaryIO, limit: int) -> None:
        self._stream = stream
        self._limit = limit

    def read(self, length: int) -> bytes:
        if length > self._limit:
            raise ValueError(f"{length} bytes are too many")
        return self._stream.read(length)
