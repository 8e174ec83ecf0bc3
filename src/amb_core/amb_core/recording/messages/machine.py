"""amb_msgs/Machine: axes, bearings and sample rate of the plant's side of the loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from amb_core.loop.machine import Machine, MachineAxis, MachineBearing

M = TypeVar("M", bound=Any)

MACHINE = "amb_msgs/msg/Machine"


def fill_machine(message: M, axis: Callable[[], Any], bearing: Callable[[], Any], machine: Machine) -> M:
    """Set the fields of a Machine message, except its stamp; `axis` and `bearing` make empty messages of its parts."""
    message.name, message.source, message.sample_rate = machine.name, machine.source, machine.sample_rate
    message.axes = [axis() for _ in machine.axes]
    for part, own in zip(message.axes, machine.axes, strict=True):
        part.name, part.bearing, part.direction = own.name, own.bearing, list(own.direction)
        part.sensor_position, part.actuator_position = own.sensor_position, own.actuator_position
        part.bias_current, part.current_limit = own.bias_current, own.current_limit
    message.bearings = [bearing() for _ in machine.bearings]
    for part, of_machine in zip(message.bearings, machine.bearings, strict=True):
        part.name, part.clearance = of_machine.name, of_machine.clearance
    return message


def machine_from_message(message: Any) -> Machine:
    """The machine of a Machine message, of ROS or from a bag."""
    axes = (
        MachineAxis(
            str(part.name), str(part.bearing), float(part.sensor_position), float(part.actuator_position),
            (float(part.direction[0]), float(part.direction[1]), float(part.direction[2])),
            float(part.bias_current), float(part.current_limit),
        )
        for part in message.axes
    )  # fmt: skip
    bearings = (MachineBearing(str(part.name), float(part.clearance)) for part in message.bearings)
    return Machine(str(message.name), str(message.source), float(message.sample_rate), tuple(axes), tuple(bearings))
