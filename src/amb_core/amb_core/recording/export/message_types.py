"""Messages of ROS 2 without ROS: made, serialized and defined, of standard types and types of one's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amb_core.recording.export.message_rows import SECOND

STAMP, HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"


class MessageTypes:
    """Standard message types of ROS 2 Jazzy, and others.

    Parameters
    ----------
    definitions : mapping of str to str, optional
        Texts of other types by name, those that others use first.
    """

    def __init__(self, definitions: Mapping[str, str] | None = None) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in (definitions or {}).items():
            self._store.register(get_types_from_msg(text, name))

    def definition(self, kind: str) -> str:
        """Text of a type, followed by those of the types it uses (encoding `ros2msg`)."""
        return self._store.generate_msgdef(kind, ros_version=2)[0]

    def type_hash(self, kind: str) -> str:
        """Hash of a type, as ROS 2 computes it (RIHS01)."""
        return self._store.hash_rihs01(kind)

    def message(self, kind: str, *fields: Any) -> Any:
        """A message of a type with its fields in their order."""
        return self._store.types[kind](*fields)

    def header(self, seconds: int, nanoseconds: int) -> Any:
        """A header with a stamp and no frame."""
        return self.message(HEADER, self.message(STAMP, seconds, nanoseconds), "")

    def header_at(self, time: int) -> Any:
        """A header with a time (ns)."""
        return self.header(time // SECOND, time % SECOND)

    def serialize(self, message: Any) -> bytes:
        """A message as bytes (CDR)."""
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))


def step_times(steps: NDArray[np.int64] | int, sample_time: float) -> NDArray[np.int64]:
    """Time of steps since step 0 of the run (ns), rounded as in the stamps of telemetry."""
    return np.round(np.asarray(steps, dtype=np.float64) * SECOND / (1.0 / sample_time)).astype(np.int64)
