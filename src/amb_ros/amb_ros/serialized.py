"""Messages in serialized form, which anybody may have published: one that cannot be read is refused."""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message

from amb_core.ground.errors import MessageError


def deserialized(data: bytes, message_type: Any) -> Any:
    """The message in serialized form.

    Raises
    ------
    MessageError
        If the bytes are no message of this type.
    """
    try:
        return deserialize_message(data, message_type)
    except (RuntimeError, ValueError, SystemError, MemoryError):
        raise unreadable(data, message_type) from None


def unreadable(data: bytes, message_type: Any) -> MessageError:
    """That the bytes are no message of a type."""
    return MessageError(f"the message cannot be read: its {len(data)} bytes are no {message_type.__name__}")
