"""Which axes of a machine belong to which bearing, and where the rotor touches it: the layout that is monitored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from amb_core.ground.errors import RegionError
from amb_core.loop.machine import Machine


@dataclass(frozen=True)
class MonitoredBearing:
    """One bearing.

    Attributes
    ----------
    name : str
        Its name.
    axes : tuple of str
        Names of its axes.
    clearance : float
        Displacement at which the rotor touches it (m), infinite if unknown.
    """

    name: str
    axes: tuple[str, ...]
    clearance: float

    @property
    def radial(self) -> bool:
        """Whether it has more than one axis; a thrust bearing has one."""
        return len(self.axes) > 1


@dataclass(frozen=True)
class Layout:
    """Axes and the bearings to which they belong.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes, in the order of all arrays of samples.
    bearings : tuple of MonitoredBearing
        The bearings.

    Raises
    ------
    RegionError
        If there is no axis, or an axis is not in exactly one bearing.
    """

    axes: tuple[str, ...]
    bearings: tuple[MonitoredBearing, ...]

    def __post_init__(self) -> None:
        in_bearings = [axis for bearing in self.bearings for axis in bearing.axes]
        if not self.axes or sorted(in_bearings) != sorted(self.axes) or len(set(self.axes)) < len(self.axes):
            raise RegionError(
                f"axes {', '.join(self.axes) or 'none'} with bearings of the axes {', '.join(in_bearings) or 'none'}; "
                "allowed: each axis in one bearing"
            )

    def columns(self, bearing: MonitoredBearing) -> list[int]:
        """Columns of a bearing in arrays of samples.

        Parameters
        ----------
        bearing : MonitoredBearing
            A bearing of the layout.

        Returns
        -------
        list of int
            Indices of its axes.
        """
        return [self.axes.index(axis) for axis in bearing.axes]

    def neighbours(self) -> list[list[int]]:
        """For each axis the columns of the others, in the order in which their inputs are taken for its own.

        First its bearing, then the same place in the other bearings: the same plane through the shaft.

        Returns
        -------
        list of list of int
            Indices of axes, one list for each axis.
        """
        columns = range(len(self.axes))
        return [
            sorted((other for other in columns if other != axis), key=lambda other: self._distance(axis, other))
            for axis in columns
        ]

    def _distance(self, axis: int, other: int) -> tuple[bool, bool, bool]:
        bearing, of_other = self._bearing_of(axis), self._bearing_of(other)
        places = bearing.axes.index(self.axes[axis]), of_other.axes.index(self.axes[other])
        return bearing != of_other, bearing.radial != of_other.radial, places[0] != places[1]

    def _bearing_of(self, column: int) -> MonitoredBearing:
        return next(bearing for bearing in self.bearings if self.axes[column] in bearing.axes)


def layout_of(machine: Machine) -> Layout:
    """The layout of a machine; a clearance that is no positive number is unknown.

    Parameters
    ----------
    machine : Machine
        The machine.

    Returns
    -------
    Layout
        Its axes, and the bearings that have any.
    """
    bearings = []
    for bearing in machine.bearings:
        axes = tuple(machine.axis_names[column] for column in machine.columns_of(bearing.name))
        if axes:
            bearings.append(MonitoredBearing(bearing.name, axes, _known(bearing.clearance)))
    return Layout(machine.axis_names, tuple(bearings))


def layout_without_machine(axes: tuple[str, ...], clearance: Mapping[str, float] | None = None) -> Layout:
    """The layout of records whose machine is not known: two axes are one bearing, x_a and y_a are bearing a.

    Any other axis is a bearing by itself.

    Parameters
    ----------
    axes : tuple of str
        Names of the axes.
    clearance : mapping of str to float, optional
        By axis, where it is known: displacement at which the rotor touches its bearing (m); one that is no positive
        number is unknown. None if it is known for no axis.

    Returns
    -------
    Layout
        The axes, and the bearings that they are taken for.
    """
    known = clearance or {}

    def bearing(name: str, *of: str) -> MonitoredBearing:
        return MonitoredBearing(name, of, min(_known(known.get(axis, math.inf)) for axis in of))

    if len(axes) == 2:
        return Layout(axes, (bearing("a", *axes),))
    bearings = []
    left = list(axes)
    while left:
        axis = left.pop(0)
        partner = "y" + axis[1:]
        if axis[:2] == "x_" and partner in left:
            left.remove(partner)
            bearings.append(bearing(axis[2:], axis, partner))
        else:
            bearings.append(bearing(axis, axis))
    return Layout(axes, tuple(bearings))


def _known(clearance: float) -> float:
    """A clearance (m), infinite if it is no positive number."""
    return clearance if clearance > 0.0 else math.inf


ONE_BEARING = layout_without_machine(("x", "y"))
