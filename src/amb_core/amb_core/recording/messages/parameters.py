"""rcl_interfaces/Parameter: names and values of a node's parameters, and a serialized ParameterEvent with them.

The event is not made with rclpy, because its `serialize_message` appends arbitrary bytes of memory to nested messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

PARAMETER_EVENT = "rcl_interfaces/msg/ParameterEvent"

ParameterValue = bool | int | float | str | list[Any] | tuple[float, ...] | None

# Fields of rcl_interfaces/ParameterValue; its type counts them from 1, see ParameterType there.
_FIELDS = (
    "bool_value",
    "integer_value",
    "double_value",
    "string_value",
    "byte_array_value",
    "bool_array_value",
    "integer_array_value",
    "double_array_value",
    "string_array_value",
)
_SCALARS = {bool: 1, int: 2, float: 3, str: 4}
_ARRAYS = {bytes: 5, bool: 6, int: 7, float: 8, str: 9}


def parameters_from_messages(messages: Iterable[Any]) -> dict[str, ParameterValue]:
    """Names and values of rcl_interfaces/Parameter messages; None for a parameter that is not set."""
    return {message.name: _parameter_value(message.value) for message in messages}


def _parameter_value(value: Any) -> ParameterValue:
    if not 1 <= value.type <= len(_FIELDS):
        return None
    name = _FIELDS[value.type - 1]
    content = getattr(value, name)
    if not name.endswith("array_value"):
        return content
    return content.tolist() if hasattr(content, "tolist") else list(content)  # numbers of Python, as files have them


def encode_parameters(types: Typestore, node: str, values: Mapping[str, ParameterValue], stamp: int) -> bytes:
    """The event that a node has these parameters at a time (ns since 1970); `types` must know the message type."""
    kinds = types.types
    parameters = [
        kinds["rcl_interfaces/msg/Parameter"](
            name=name, value=kinds["rcl_interfaces/msg/ParameterValue"](**_fields_of(value))
        )
        for name, value in values.items()
    ]
    event = kinds[PARAMETER_EVENT](
        stamp=kinds["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000)),
        node=node,
        new_parameters=parameters,
        changed_parameters=[],
        deleted_parameters=[],
    )
    return bytes(types.serialize_cdr(event, PARAMETER_EVENT))


def _fields_of(value: ParameterValue) -> dict[str, Any]:
    """Fields of rcl_interfaces/ParameterValue: the type (see ParameterType) and its field set, all others empty."""
    fields: dict[str, Any] = {
        "type": 0,
        "bool_value": False,
        "integer_value": 0,
        "double_value": 0.0,
        "string_value": "",
        "byte_array_value": np.zeros(0, np.uint8),
        "bool_array_value": np.zeros(0, np.bool_),
        "integer_array_value": np.zeros(0, np.int64),
        "double_array_value": np.zeros(0),
        "string_array_value": [],
    }
    if isinstance(value, tuple):  # numbers, also if there are none
        fields["type"] = _ARRAYS[float]
        fields["double_array_value"] = np.array(value, dtype=np.float64)
    elif isinstance(value, list):
        fields["type"] = _ARRAYS[type(value[0]) if value else str]
        fields[_FIELDS[fields["type"] - 1]] = _array(value)
    elif value is not None:
        fields["type"] = _SCALARS[type(value)]
        fields[_FIELDS[fields["type"] - 1]] = value
    return fields


def _array(values: list[Any]) -> Any:
    """As rosbags expects it: texts as a list, all others as an array; bytes are given one by one."""
    if not values or isinstance(values[0], str):
        return values
    return np.frombuffer(b"".join(values), np.uint8) if isinstance(values[0], bytes) else np.array(values)
