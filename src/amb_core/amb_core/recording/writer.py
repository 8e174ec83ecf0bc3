"""Writes bags: an MCAP file in a folder with `metadata.yaml`, as rosbag2 does, so that `ros2 bag` and Foxglove open it.

Messages are written as received, without decoding. Chunks are written to the disk by size and by age: if the recorder
is killed, its file is readable up to the last chunk. Format: https://mcap.dev/spec and rosbag2 metadata version 9.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from mcap.writer import Writer
from rosbags.typesys import Stores, TypesysError, get_typestore

from amb_core.errors import BagError
from amb_core.recording.decoder import register
from amb_core.recording.messages.parameters import ParameterValue, encode_parameters
from amb_core.recording.storage import Definition

METADATA_VERSION = 9
SHOWN = 200  # characters shown of an invalid path
CHUNK_SIZE = 256 * 1024
"""Bytes after which a chunk is written regardless of its age."""


@dataclass
class _Topic:
    channel: int
    metadata: dict[str, Any]
    messages: int = 0


class BagWriter:
    """A bag being written.

    Parameters
    ----------
    folder : path
        Folder of the bag; must not exist.
    chunk_age : float, optional
        Longest time that a message waits in memory while messages arrive (s). If they may stop arriving, call `flush`
        from a timer.

    Raises
    ------
    BagError
        If the folder exists or cannot be made.
    """

    def __init__(self, folder: str | Path, chunk_age: float = 0.5) -> None:
        self.folder = Path(folder).absolute()
        self._chunk_age = chunk_age
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._types = get_typestore(Stores.EMPTY)
        self._start, self._end = 2**63 - 1, 0
        self._file_name = f"{self.folder.name}_0.mcap"
        try:
            if self.folder.exists():
                raise BagError(f"bag {self.folder}: exists already; name a folder that does not")
            self.folder.mkdir(parents=True)
            self._stream = (self.folder / self._file_name).open("xb")
        except OSError as problem:
            raise BagError(f"bag {str(self.folder)[:SHOWN]}: cannot be made: {problem.strerror}") from None
        except ValueError as problem:  # a zero byte in the name
            raise BagError(f"bag {str(self.folder)[:SHOWN]!r}: cannot be made: {problem}") from None
        self._writer = Writer(self._stream, chunk_size=CHUNK_SIZE)
        self._writer.start(profile="ros2", library="amb_core")
        self._flushed = time.monotonic()

    @property
    def messages(self) -> int:
        """Number of messages written."""
        return sum(topic.messages for topic in self._topics.values())

    def add_topic(
        self, name: str, message_type: str, definition: str, offered_qos: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        """Add a topic before its first message.

        Parameters
        ----------
        name : str
            Full topic name.
        message_type : str
            As `package/msg/Name`.
        definition : str
            Text of the `.msg` file, followed by those of the types it uses, each after a line of 80 `=` and a line
            `MSG: package/Name`.
        offered_qos : sequence of mapping, optional
            Quality of service that its publishers offer, in the format of rosbag2's metadata; a player of the bag
            offers the same. Reliable and volatile by default.
        """
        if message_type not in self._schemas:
            try:
                register(self._types, message_type, Definition("ros2msg", definition))
            except TypesysError as problem:
                raise BagError(f"bag {self.folder}: definition of {message_type} is wrong: {problem}") from None
            self._schemas[message_type] = self._writer.register_schema(message_type, "ros2msg", definition.encode())
        type_hash = self._types.hash_rihs01(message_type)
        profiles = [dict(profile) for profile in offered_qos] or [_reliable_profile()]
        channel = self._writer.register_channel(
            name,
            "cdr",
            self._schemas[message_type],
            {"offered_qos_profiles": yaml.safe_dump(profiles), "topic_type_hash": type_hash},
        )
        metadata = {
            "name": name,
            "type": message_type,
            "serialization_format": "cdr",
            "offered_qos_profiles": profiles,
            "type_description_hash": type_hash,
        }
        self._topics[name] = _Topic(channel, metadata)

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int | None = None) -> None:
        """Append a message as received (CDR with its encapsulation header); times in ns since 1970.

        Raises
        ------
        BagError
            If it cannot be written, for example because the disk is full.
        """
        entry = self._topics[topic]
        try:
            self._writer.add_message(entry.channel, log_time, data, log_time if publish_time is None else publish_time)
        except OSError as problem:
            raise self._unwritable(problem) from None
        entry.messages += 1
        self._start, self._end = min(self._start, log_time), max(self._end, log_time)
        if time.monotonic() - self._flushed > self._chunk_age:
            self.flush()

    def write_parameters(self, topic: str, node: str, values: Mapping[str, ParameterValue], log_time: int) -> None:
        """Append the parameters of a node to a topic of type rcl_interfaces/msg/ParameterEvent."""
        self.write(topic, encode_parameters(self._types, node, values, log_time), log_time)

    def flush(self) -> None:
        """Write the chunk in progress to the disk.

        Raises
        ------
        BagError
            If it cannot be written.
        """
        self._flushed = time.monotonic()
        try:
            self._writer.flush()
        except OSError as problem:
            raise self._unwritable(problem) from None

    def close(self) -> None:
        """Write the rest, the index and `metadata.yaml`.

        Raises
        ------
        BagError
            If they cannot be written; everything on the disk remains readable.
        """
        try:
            self._writer.finish()
            self._stream.close()
            (self.folder / "metadata.yaml").write_text(yaml.safe_dump(self._metadata(), sort_keys=False))
        except OSError as problem:
            raise self._unwritable(problem) from None
        finally:
            # Closing tries again to write the rest, fails again, but still closes the file.
            with contextlib.suppress(OSError):
                self._stream.close()

    def __enter__(self) -> BagWriter:
        """Nothing more to do: the bag is open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the bag."""
        self.close()

    def _unwritable(self, problem: OSError) -> BagError:
        return BagError(f"bag {self.folder}: cannot be written: {problem.strerror}")

    def _metadata(self) -> dict[str, Any]:
        messages = self.messages
        starting_time = {"nanoseconds_since_epoch": self._start}
        duration = {"nanoseconds": self._end - self._start if messages else 0}
        return {
            "rosbag2_bagfile_information": {
                "version": METADATA_VERSION,
                "storage_identifier": "mcap",
                "duration": duration,
                "starting_time": starting_time,
                "message_count": messages,
                "topics_with_message_count": [
                    {"topic_metadata": topic.metadata, "message_count": topic.messages}
                    for topic in self._topics.values()
                ],
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [self._file_name],
                "files": [
                    {
                        "path": self._file_name,
                        "starting_time": starting_time,
                        "duration": duration,
                        "message_count": messages,
                    }
                ],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }


def _reliable_profile() -> dict[str, Any]:
    """A reliable, volatile quality-of-service profile in rosbag2's format; its largest times mean unlimited."""
    unlimited = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": 2000,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": dict(unlimited),
        "lifespan": dict(unlimited),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(unlimited),
        "avoid_ros_namespace_conventions": False,
    }
