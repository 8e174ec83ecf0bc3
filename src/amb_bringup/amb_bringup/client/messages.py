"""Requests and goals, each value converted to the type of its field.

rclpy checks types only if the environment asks for it. Without, it reads the memory of any value as that of a number of
Python: an integer for a float64 arrives as another number, and nobody can see that.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np

from amb_bringup.client.errors import ClientError
from amb_core.ground.errors import bounded
from amb_core.ground.plain_text import is_for_ros

_SEQUENCE = re.compile(r"sequence<([^,>]+)(?:, \d+)?>|(.+)\[\d+\]")
_WHOLE = re.compile(r"(u?)int(8|16|32|64)")
_SINGLE = "biufU"  # kinds of NumPy's numbers and texts


def filled(kind: Any, name: str, fields: Mapping[str, Any]) -> Any:
    """A message with these fields.

    Parameters
    ----------
    kind : type
        Type of the message, such as `StartExcitation.Request`.
    name : str
        Name of the service or action, for errors.
    fields : mapping of str to object
        Values of its fields: numbers and texts of Python or NumPy.

    Returns
    -------
    kind
        The message.

    Raises
    ------
    ClientError
        If a value is none of its field's type, or there is no such field; one line.
    """
    values = {field: converted(kind, name, field, value) for field, value in fields.items()}
    refuse_cut_texts(name, values)
    return kind(**values)


def converted(kind: Any, name: str, field: str, value: Any) -> Any:
    """A value as the type of a field of a message; parameters and errors as for `filled`."""
    types = kind.get_fields_and_field_types()
    if field not in types:
        raise ClientError(f"{name}: unknown field '{field}'; allowed: {', '.join(types)}")
    sequence = _SEQUENCE.fullmatch(types[field])
    if sequence is None:
        allowed, convert = _conversion(types[field])
        try:
            return convert(value)
        except (ValueError, OverflowError):
            raise _refusal(name, field, value, allowed) from None
    allowed, convert = _conversion(sequence[1] or sequence[2])
    try:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            raise ValueError
        return [convert(item) for item in value]
    except (ValueError, OverflowError, TypeError):  # TypeError: an array without dimensions
        raise _refusal(name, field, value, f"a list, each {allowed}") from None


def refuse_cut_texts(name: str, fields: Mapping[str, Any]) -> None:
    """Raise ClientError for a text that ROS does not carry whole: it would be cut, and no node can see that."""
    for field, value in fields.items():
        for text in value if isinstance(value, list | tuple) else [value]:
            if isinstance(text, str) and not is_for_ros(text):
                raise ClientError(
                    f"{name}: {field} = {bounded(repr(text), 200)} has a NUL character or is no Unicode; allowed: "
                    "Unicode text without NUL"
                )


def _refusal(name: str, field: str, value: Any, allowed: str) -> ClientError:
    shown = bounded(" ".join(repr(value).split()), 200)
    return ClientError(f"{name}: {field} = {shown} is not allowed; allowed: {allowed}")


def _conversion(kind: str) -> tuple[str, Callable[[Any], Any]]:
    """What a field of this type takes, and the function that converts it or raises ValueError or OverflowError."""
    if whole := _WHOLE.fullmatch(kind):
        bits = int(whole[2])
        least, most = (0, 2**bits - 1) if whole[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return f"a whole number from {least} to {most}", lambda value: _whole(value, least, most)
    return _CONVERSIONS.get(kind, ("a message", lambda value: value))


def _of_python(value: Any) -> Any:
    """A number or text of NumPy as that of Python; anything else, such as a masked or a missing one, as it is."""
    single = isinstance(value, np.generic) or (type(value) is np.ndarray and value.ndim == 0)
    return value.item() if single and value.dtype.kind in _SINGLE else value


def _whole(value: Any, least: int, most: int) -> int:
    number = _of_python(value)
    if isinstance(number, bool) or not isinstance(number, Integral) or not least <= int(number) <= most:
        raise ValueError
    return int(number)


def _number(value: Any) -> float:
    number = _of_python(value)
    if isinstance(number, bool | np.timedelta64) or not isinstance(number, Real):
        raise ValueError
    return float(number)


def _switch(value: Any) -> bool:
    switch = _of_python(value)
    if not isinstance(switch, bool):
        raise ValueError
    return switch


def _text(value: Any) -> str:
    text = _of_python(value)
    if not isinstance(text, str):
        raise ValueError
    return str(text)


_CONVERSIONS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "boolean": ("True or False", _switch),
    "double": ("a number", _number),
    "float": ("a number", _number),
    "string": ("text", _text),
}
