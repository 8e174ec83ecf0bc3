"""Writes bags: MCAP files in a folder with `metadata.yaml`, as rosbag2 does, so that `ros2 bag` and Foxglove open them.

Messages are written as received, without decoding. Chunks are written to the disk by size and by age: if the recorder
is killed, its files are readable up to the last chunk.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from rosbags.typesys import Stores, TypesysError, get_typestore

from amb_core.ground.errors import BagError
from amb_core.ground.given_values import path_of
from amb_core.recording.bag_metadata import write_metadata
from amb_core.recording.decoder import register
from amb_core.recording.mcap_file import McapFile, StoredTopic
from amb_core.recording.messages.parameters import ParameterValue, encode_parameters
from amb_core.recording.storage import Definition

SHOWN = 200  # characters shown of an invalid path


class BagWriter:
    """A bag being written.

    Parameters
    ----------
    folder : path
        Folder of the bag; must not exist.
    chunk_age : float, optional
        Longest time that a message waits in memory while messages arrive (s). If they may stop arriving, call `flush`
        from a timer.
    split_size : float, optional
        Size at which a file is closed and the next one begins (B) (bytes); 0: none.
    split_period : float, optional
        Time between the first messages of two files (s); 0: none.

    Raises
    ------
    BagError
        If the folder exists or cannot be made.
    """

    def __init__(
        self, folder: str | Path, chunk_age: float = 0.5, split_size: float = 0.0, split_period: float = 0.0
    ) -> None:
        self.folder = path_of("folder", folder, BagError).absolute()
        self._chunk_age = chunk_age
        self._split_size = split_size or float("inf")
        self._split_period = 1e9 * (split_period or float("inf"))
        self._topics: dict[str, StoredTopic] = {}
        self._definitions: dict[str, bytes] = {}
        self._types = get_typestore(Stores.EMPTY)
        try:
            if self.folder.exists():
                raise BagError(f"bag {self.folder}: exists already; name a folder that does not")
            self.folder.mkdir(parents=True)
            self._file = McapFile(self.folder / f"{self.folder.name}_0.mcap")
        except OSError as problem:
            raise BagError(f"bag {str(self.folder)[:SHOWN]}: cannot be made: {problem.strerror}") from None
        except ValueError as problem:  # a zero byte in the name
            raise BagError(f"bag {str(self.folder)[:SHOWN]!r}: cannot be made: {problem}") from None
        self._contents = [self._file.content]  # of all files; the files themselves keep an index in memory
        self._flushed = time.monotonic()

    @property
    def messages(self) -> int:
        """Number of messages on the disk and in the chunk in progress."""
        return sum(content.counts.total() for content in self._contents)

    @property
    def saved(self) -> int:
        """Number of messages on the disk; only they remain if the disk fails."""
        return self.messages - self._file.pending

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

        Raises
        ------
        BagError
            If the definition is wrong.
        """
        if message_type not in self._definitions:
            try:
                register(self._types, message_type, Definition("ros2msg", definition))
            except TypesysError as problem:
                raise BagError(f"bag {self.folder}: definition of {message_type} is wrong: {problem}") from None
            self._definitions[message_type] = definition.encode()
        profiles = [dict(profile) for profile in offered_qos] or [_reliable_profile()]
        self._topics[name] = StoredTopic(
            name,
            message_type,
            "ros2msg",
            self._definitions[message_type],
            metadata={
                "offered_qos_profiles": yaml.safe_dump(profiles),
                "topic_type_hash": self._types.hash_rihs01(message_type),
            },
        )
        self._file.add_topic(self._topics[name])

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int | None = None) -> None:
        """Append a message as received (CDR with its encapsulation header); times in ns since 1970.

        Parameters
        ----------
        topic : str
            Full name of a topic that was added.
        data : bytes
            The message.
        log_time : int
            When it was received.
        publish_time : int, optional
            When it was sent; by default `log_time`.

        Raises
        ------
        BagError
            If it cannot be written, for example because the disk is full.
        """
        try:
            if self._is_file_full(log_time):
                self._begin_next_file()
            self._file.write(self._topics[topic], data, log_time, log_time if publish_time is None else publish_time)
        except OSError as problem:
            raise self._unwritable(problem) from None
        if time.monotonic() - self._flushed > self._chunk_age:
            self.flush()

    def parameter_event(self, node: str, values: Mapping[str, ParameterValue], log_time: int) -> bytes:
        """The parameters of a node as a message of type rcl_interfaces/msg/ParameterEvent, which a topic must have.

        Parameters
        ----------
        node : str
            Full name of the node.
        values : mapping of str to ParameterValue
            Its parameters by name, in the units of their declarations.
        log_time : int
            Time of the message (ns since 1970).

        Returns
        -------
        bytes
            The message in CDR.
        """
        return encode_parameters(self._types, node, values, log_time)

    def write_parameters(self, topic: str, node: str, values: Mapping[str, ParameterValue], log_time: int) -> None:
        """Append the parameters of a node to a topic of type rcl_interfaces/msg/ParameterEvent.

        Parameters
        ----------
        topic : str
            Full name of a topic that was added.
        node : str
            Full name of the node.
        values : mapping of str to ParameterValue
            Its parameters by name, in the units of their declarations.
        log_time : int
            Time of the message (ns since 1970).
        """
        self.write(topic, self.parameter_event(node, values, log_time), log_time)

    def flush(self) -> None:
        """Write the chunk in progress to the disk.

        Raises
        ------
        BagError
            If it cannot be written.
        """
        self._flushed = time.monotonic()
        try:
            self._file.flush()
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
            self._file.close()
            write_metadata(self.folder, list(self._topics.values()), self._contents)
        except OSError as problem:
            raise self._unwritable(problem) from None

    def __enter__(self) -> BagWriter:
        """Nothing more to do: the bag is open."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the bag."""
        self.close()

    def _is_file_full(self, log_time: int) -> bool:
        content = self._file.content
        return bool(content.counts) and (
            self._file.size >= self._split_size or log_time - content.start >= self._split_period
        )

    def _begin_next_file(self) -> None:
        """Close the file, and open the next one with all topics. No message is repeated, as in rosbag2."""
        self._file.close()
        self._file = McapFile(self.folder / f"{self.folder.name}_{len(self._contents)}.mcap")
        self._contents.append(self._file.content)
        for topic in self._topics.values():
            self._file.add_topic(topic)

    def _unwritable(self, problem: OSError) -> BagError:
        return BagError(f"bag {self.folder}: cannot be written: {problem.strerror}")


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
