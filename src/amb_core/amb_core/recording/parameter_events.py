"""Parameters of a node as a serialized rcl_interfaces/ParameterEvent, without ROS.

Made here and not with rclpy, whose `serialize_message` leaves a tail of stray memory behind nested messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from amb_core.recording.messages import ParameterValue

PARAMETER_EVENT = "rcl_interfaces/msg/ParameterEvent"
_SCALARS = {bool: (1, "bool_value"), int: (2, "integer_value"), float: (3, "double_value"), str: (4, "string_value")}
_ARRAYS = {
    bytes: (5, "byte_array_value"),
    bool: (6, "bool_array_value"),
    int: (7, "integer_array_value"),
    float: (8, "double_array_value"),
    str: (9, "string_array_value"),
}


def encode_parameters(types: Typestore, node: str, values: Mapping[str, ParameterValue], stamp: int) -> bytes:
    """The event that a node has these parameters at a time (ns since 1970); `types` must know the message type."""
    kinds = types.types
    parameters = [
        kinds["rcl_interfaces/msg/Parameter"](
            name=name, value=kinds["rcl_interfaces/msg/ParameterValue"](**_parameter_value(value))
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


def _parameter_value(value: ParameterValue) -> dict[str, Any]:
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
    if isinstance(value, list):
        fields["type"], name = _ARRAYS[type(value[0]) if value else str]
        if name == "byte_array_value":
            fields[name] = np.frombuffer(b"".join(value), np.uint8)
        elif name == "string_array_value":
            fields[name] = value
        else:
            fields[name] = np.array(value)
    elif value is not None:
        fields["type"], name = _SCALARS[type(value)]
        fields[name] = value
    return fields
