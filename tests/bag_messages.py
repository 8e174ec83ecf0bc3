"""Messages of the workbench as bags hold them, from records: for tests that write bags without ROS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord

TYPES = get_typestore(Stores.ROS2_JAZZY)
for file in (Path(__file__).parents[1] / "amb_msgs" / "msg").glob("*.msg"):
    TYPES.register(get_types_from_msg(file.read_text(), f"amb_msgs/msg/{file.stem}"))

MACHINE = "amb_msgs/msg/Machine"
TELEMETRY, PARAMETERS = "amb_msgs/msg/LoopSamples", "rcl_interfaces/msg/ParameterEvent"


def definition(kind: str) -> str:
    """The definition of a message type, as a bag holds it."""
    return TYPES.generate_msgdef(kind, ros_version=2)[0]


def telemetry(record: LoopRecord, run: int = 1) -> bytes:
    """A serialized LoopSamples with all samples of a record."""
    header = TYPES.types["std_msgs/msg/Header"](TYPES.types["builtin_interfaces/msg/Time"](0, 0), "")
    axes = [
        TYPES.types["amb_msgs/msg/AxisSamples"](name, *(part[:, axis].copy() for part in _signals(record)))
        for axis, name in enumerate(record.axes)
    ]
    content = TYPES.types[TELEMETRY](header, run, record.first_step, record.sample_time, axes)
    return bytes(TYPES.serialize_cdr(content, TELEMETRY))


def machine_message(machine: Machine) -> bytes:
    """A serialized Machine."""
    header = TYPES.types["std_msgs/msg/Header"](TYPES.types["builtin_interfaces/msg/Time"](0, 0), "")
    axes = [
        TYPES.types["amb_msgs/msg/MachineAxis"](
            axis.name, axis.bearing, axis.sensor_position, axis.actuator_position, np.array(axis.direction),
            axis.bias_current, axis.current_limit,
        )
        for axis in machine.axes
    ]  # fmt: skip
    bearings = [TYPES.types["amb_msgs/msg/MachineBearing"](part.name, part.clearance) for part in machine.bearings]
    content = TYPES.types[MACHINE](header, machine.name, machine.source, machine.sample_rate, axes, bearings)
    return bytes(TYPES.serialize_cdr(content, MACHINE))


def _signals(record: LoopRecord) -> tuple:
    return record.reference, record.position, record.current
