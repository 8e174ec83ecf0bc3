"""Axes that a region map excites, in the names of its machine."""

from __future__ import annotations

from amb_core.loop.machine import DIRECTIONS, Machine

_OF_ONE_BEARING = {"x": ("x",), "y": ("y",), "both": ("x", "y")}


def axes_of_first_bearing(axes: str, machine: Machine) -> str:
    """`x`, `y` and `both` as names of axes of the machine's first bearing; all else as it is.

    A machine whose own axes have these names, one radial bearing, keeps them.
    """
    if axes not in _OF_ONE_BEARING or set(_OF_ONE_BEARING[axes]) <= set(machine.axis_names):
        return axes
    wanted = [DIRECTIONS[name] for name in _OF_ONE_BEARING[axes]]
    first = [machine.axes[column] for column in machine.columns_of(machine.bearings[0].name)]
    return ",".join(axis.name for axis in first if axis.direction in wanted) or axes
