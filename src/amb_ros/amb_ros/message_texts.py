"""The texts of a message as ROS carries them: one with a NUL or a lone surrogate is sent with escapes."""

from __future__ import annotations

from typing import Any, TypeVar

from amb_core.ground.plain_text import is_for_ros, plain_text

M = TypeVar("M", bound=Any)


def with_plain_texts(message: M) -> M:
    """The message itself, whose texts that ROS does not carry whole have become plain ones.

    Other texts stay as they are: a path with a control character is still that path.
    """
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if isinstance(value, list):  # of texts or messages; numbers have arrays of their own
            value[:] = map(_plain, value)
        else:
            setattr(message, name, _plain(value))
    return message


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return value if is_for_ros(value) else plain_text(value)
    return with_plain_texts(value) if hasattr(value, "get_fields_and_field_types") else value
