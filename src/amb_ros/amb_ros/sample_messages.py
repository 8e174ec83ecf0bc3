"""The two per-sample messages as serialized bytes, which halves the cost of a step against message objects.

rclpy converts every field of a message object by name, twice per message. The loop sends two messages per step and
knows their layout, so it packs and unpacks their CDR itself: little endian, a 4-byte header, members aligned to their
size. The tests compare this layout with rclpy's own serialization.
"""

from __future__ import annotations

from struct import Struct

from rclpy.serialization import deserialize_message

from amb_msgs.msg import CurrentReference, RotorPosition

_HEADER = b"\x00\x01\x00\x00"  # CDR, little endian

_POSITION = Struct("<4sQQddd")
_CURRENT = Struct("<4sQQdd")

Position = tuple[int, int, float, float, float]
Current = tuple[int, int, float, float]


def pack_position(run: int, step: int, time: float, x: float, y: float) -> bytes:
    """A serialized RotorPosition: run, step, time (s), x and y (m)."""
    return _POSITION.pack(_HEADER, run, step, time, x, y)


def unpack_position(data: bytes) -> Position:
    """Run, step, time (s), x and y (m) of a serialized RotorPosition."""
    header, run, step, time, x, y = _POSITION.unpack_from(data)
    if header != _HEADER:  # from a machine of another byte order
        message = deserialize_message(data, RotorPosition)
        return message.run, message.step, message.time, message.x, message.y
    return run, step, time, x, y


def pack_current(run: int, step: int, i_x: float, i_y: float) -> bytes:
    """A serialized CurrentReference: run, step, i_x and i_y (A)."""
    return _CURRENT.pack(_HEADER, run, step, i_x, i_y)


def unpack_current(data: bytes) -> Current:
    """Run, step, i_x and i_y (A) of a serialized CurrentReference."""
    header, run, step, i_x, i_y = _CURRENT.unpack_from(data)
    if header != _HEADER:
        message = deserialize_message(data, CurrentReference)
        return message.run, message.step, message.i_x, message.i_y
    return run, step, i_x, i_y
