"""The two per-sample messages as serialized bytes, which halves the cost of a step against message objects.

rclpy converts every field of a message object by name, twice per message. The loop sends two messages per step and
knows their layout, so it packs and unpacks their CDR itself: little endian, a 4-byte header, members aligned to their
size, a sequence as its length and its members. The tests compare this layout with rclpy's own serialization.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from struct import Struct, error

from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros.serialized import deserialized, unreadable

_HEADER = b"\x00\x01\x00\x00"  # CDR, little endian

_POSITION, _POSITIONS_AT = Struct("<4sQQdI"), 36  # the doubles begin at a multiple of 8 after the header
_CURRENT, _CURRENTS_AT = Struct("<4sQQI"), 28

Position = tuple[int, int, float, Sequence[float]]
Current = tuple[int, int, Sequence[float]]


def pack_position(run: int, step: int, time: float, position: Sequence[float]) -> bytes:
    """A serialized RotorPosition: run, step, time (s), position of each axis (m)."""
    count = len(position)
    return _position_of(count).pack(_HEADER, run, step, time, count, *position)


def unpack_position(data: bytes) -> Position:
    """Run, step, time (s) and the position of each axis (m) of a serialized RotorPosition; MessageError if none."""
    try:
        header, run, step, time, count = _POSITION.unpack_from(data)
    except error:  # too short
        raise unreadable(data, RotorPosition) from None
    if header != _HEADER:  # from a machine of another byte order
        message = deserialized(data, RotorPosition)
        return message.run, message.step, message.time, message.position
    return run, step, time, _doubles(data, _POSITIONS_AT, count)


def pack_current(run: int, step: int, current: Sequence[float]) -> bytes:
    """A serialized CurrentReference: run, step, control current reference of each axis (A)."""
    count = len(current)
    return _current_of(count).pack(_HEADER, run, step, count, *current)


def unpack_current(data: bytes) -> Current:
    """Run, step and the current reference of each axis (A) of a serialized CurrentReference; MessageError if none."""
    try:
        header, run, step, count = _CURRENT.unpack_from(data)
    except error:
        raise unreadable(data, CurrentReference) from None
    if header != _HEADER:
        message = deserialized(data, CurrentReference)
        return message.run, message.step, message.current
    return run, step, _doubles(data, _CURRENTS_AT, count)


@lru_cache(maxsize=8)
def _position_of(count: int) -> Struct:
    return Struct(f"<4sQQdI4x{count}d")


@lru_cache(maxsize=8)
def _current_of(count: int) -> Struct:
    return Struct(f"<4sQQI4x{count}d")


@lru_cache(maxsize=8)
def _sequence_of(count: int) -> Struct:
    return Struct(f"<{count}d")


def _doubles(data: bytes, start: int, count: int) -> Sequence[float]:
    """Doubles from a position onwards; none if there are fewer."""
    if count * 8 > len(data) - start:
        return ()
    values: Sequence[float] = _sequence_of(count).unpack_from(data, start)
    return values
