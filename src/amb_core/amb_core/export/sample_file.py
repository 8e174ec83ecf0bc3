"""An MCAP file with one message per sample, and the times of a run as its times.

Definitions of all message types are in the file, so a reader needs no message packages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amb_core.export.message_rows import SECOND, MessageRows
from amb_core.recording.mcap_file import McapFile, StoredTopic

STAMP, HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"


class SampleFile:
    """A file being written; closed at the end of a `with` block.

    Parameters
    ----------
    path : Path
        The file; must not exist.
    sample_time : float
        Sample time (s).
    definitions : mapping of str to str, optional
        Message types beside the standard ones: their texts by name, those that others use first.
    """

    def __init__(self, path: Path, sample_time: float, definitions: Mapping[str, str] | None = None) -> None:
        self._types = get_typestore(Stores.ROS2_JAZZY)
        for name, text in (definitions or {}).items():
            self._types.register(get_types_from_msg(text, name))
        self._rate = 1.0 / sample_time
        self._topics: dict[str, StoredTopic] = {}
        self._file = McapFile(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._file.close()
        else:
            with suppress(OSError):  # the first error counts
                self._file.close()

    def time(self, steps: NDArray[np.int64] | int) -> Any:
        """Time of steps since step 0 of the run (ns), rounded as in the stamps of telemetry."""
        return np.round(np.asarray(steps, dtype=np.float64) * SECOND / self._rate).astype(np.int64)

    def add_topic(self, name: str, kind: str) -> None:
        """Add a topic before its first message; `kind` is a standard type or one of the definitions."""
        definition, _ = self._types.generate_msgdef(kind, ros_version=2)
        metadata = {"offered_qos_profiles": "", "topic_type_hash": self._types.hash_rihs01(kind)}
        self._topics[name] = StoredTopic(name, kind, "ros2msg", definition.encode(), metadata=metadata)
        self._file.add_topic(self._topics[name])

    def add_stored_topic(self, name: str, topic: StoredTopic) -> None:
        """Add a topic whose messages come from a bag as they are stored."""
        self._topics[name] = StoredTopic(name, topic.type, topic.encoding, topic.definition)
        self._file.add_topic(self._topics[name])

    def message(self, kind: str, *fields: Any) -> Any:
        """A message of a type with its fields in their order."""
        return self._types.types[kind](*fields)

    def header(self, seconds: int, nanoseconds: int) -> Any:
        """A header with a stamp and no frame."""
        return self.message(HEADER, self.message(STAMP, seconds, nanoseconds), "")

    def header_at(self, step: int) -> Any:
        """A header with the time of a step."""
        time = int(self.time(step))
        return self.header(time // SECOND, time % SECOND)

    def serialize(self, message: Any) -> bytes:
        """A message as bytes (CDR)."""
        return bytes(self._types.serialize_cdr(message, message.__msgtype__))

    def write(self, topic: str, message: Any, step: int) -> None:
        """Append a message at the time of a step."""
        self.write_stored(topic, self.serialize(message), step)

    def write_stored(self, topic: str, data: bytes, step: int) -> None:
        """Append a serialized message at the time of a step."""
        time = int(self.time(step))
        self._file.write(self._topics[topic], data, time, time)

    def write_rows(
        self, topic: str, rows: MessageRows, steps: NDArray[np.int64], columns: Sequence[NDArray[Any]]
    ) -> None:
        """Append a message for each step; `columns` as for `MessageRows.messages`."""
        times = self.time(steps)
        self._append(topic, times.tolist(), rows.messages(times, columns))

    def _append(self, topic: str, times: Iterable[int], messages: Iterable[bytes]) -> None:
        stored, write = self._topics[topic], self._file.write
        for time, data in zip(times, messages, strict=True):
            write(stored, data, time, time)
