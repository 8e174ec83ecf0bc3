"""An MCAP file with one message per sample, and the times of a run as its times.

Definitions of all message types are in the file, so a reader needs no message packages.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from amb_core.recording.export.message_types import MessageTypes, step_times
from amb_core.recording.mcap_file import McapFile, StoredTopic


class SampleFile:
    """A file being written; closed at the end of a `with` block.

    Parameters
    ----------
    path : Path
        The file; must not exist.
    sample_time : float
        Sample time (s).
    types : MessageTypes
        Types of its messages.
    """

    def __init__(self, path: Path, sample_time: float, types: MessageTypes) -> None:
        self.types = types
        self._sample_time = sample_time
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

    def times(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of steps (ns)."""
        return step_times(steps, self._sample_time)

    def time(self, step: int) -> int:
        """Time of a step (ns)."""
        return int(step_times(step, self._sample_time))

    def add_topic(self, name: str, kind: str) -> None:
        """Add a topic before its first message; `kind` is one of the types."""
        metadata = {"offered_qos_profiles": "", "topic_type_hash": self.types.type_hash(kind)}
        definition = self.types.definition(kind).encode()
        self._topics[name] = StoredTopic(name, kind, "ros2msg", definition, metadata=metadata)
        self._file.add_topic(self._topics[name])

    def add_stored_topic(self, name: str, topic: StoredTopic) -> None:
        """Add a topic whose messages come from a bag as they are stored."""
        self._topics[name] = StoredTopic(name, topic.type, topic.encoding, topic.definition)
        self._file.add_topic(self._topics[name])

    def write(self, topic: str, message: Any, step: int) -> None:
        """Append a message at the time of a step."""
        self.write_stored(topic, self.types.serialize(message), step)

    def write_stored(self, topic: str, data: bytes, step: int) -> None:
        """Append a serialized message at the time of a step."""
        time = self.time(step)
        self._file.write(self._topics[topic], data, time, time)

    def write_all(self, topic: str, times: NDArray[np.int64], messages: Iterable[bytes]) -> None:
        """Append serialized messages at their times (ns)."""
        stored, write = self._topics[topic], self._file.write
        for time, data in zip(times.tolist(), messages, strict=True):
            write(stored, data, time, time)
