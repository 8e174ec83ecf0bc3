"""The machine: axes, bearings and sample rate of the plant's side of the loop, as topic `machine` describes it.

Arrays of samples have a column per axis, in the order of the machine: x, y of one bearing; x_a, y_a, x_b, y_b of a
rotor in two; z after them with a thrust bearing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from amb_core.ground.errors import MachineError, bounded
from amb_core.ground.given_values import kind_of, number, require_kind
from amb_core.linear.model.whirl import sensor_planes
from amb_core.loop.records import LoopRecord, axis_names

MOST_AXES = 16  # and bearings
LONGEST_NAME = 64  # characters; names are repeated in messages and logs
HIGHEST_SAMPLE_RATE = 1e6  # Hz


@dataclass(frozen=True, eq=False)
class MachineAxis:
    """One axis of control. Two are equal if all values are; a position that is not known equals another such one.

    Attributes
    ----------
    name : str
        Its name.
    bearing : str
        Name of the bearing to which it belongs.
    sensor_position, actuator_position : float
        Axial position of its sensor and of its magnets along the shaft (m); NaN if not known.
    direction : tuple of float
        Unit vector of a positive position in the stator frame: x horizontal, y up, z along the shaft.
    bias_current : float
        Bias current of its coils (A).
    current_limit : float
        Largest control current that its coils follow (A); infinite without limits.
    """

    name: str
    bearing: str
    sensor_position: float
    actuator_position: float
    direction: tuple[float, float, float]
    bias_current: float
    current_limit: float

    def __eq__(self, other: object) -> bool:
        return self._values == other._values if isinstance(other, MachineAxis) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values)

    @property
    def _values(self) -> tuple[object, ...]:
        """All values, with None for NaN, which equals nothing."""
        return tuple(None if value != value else value for value in vars(self).values())


@dataclass(frozen=True)
class MachineBearing:
    """A bearing, with the displacement at which the rotor touches its backup bearing (m)."""

    name: str
    clearance: float


@dataclass(frozen=True)
class Machine:
    """What controller, monitor, recorder and identification need to know of the plant's side.

    Raises
    ------
    MachineError
        If it has no axis or too many, a name is too long, two axes have one name, an axis lies in no bearing, or the
        sample rate is no positive number.

    Attributes
    ----------
    name : str
        Of the machine.
    source : str
        `simulator`, or `bridge` for a rig.
    sample_rate : float
        Controller sample rate f_s (Hz).
    axes : tuple of MachineAxis
        In the order of all arrays of samples.
    bearings : tuple of MachineBearing
        In the order of their axes.
    """

    name: str
    source: str
    sample_rate: float
    axes: tuple[MachineAxis, ...]
    bearings: tuple[MachineBearing, ...]

    def __post_init__(self) -> None:
        _require_tuple("axes", self.axes, MachineAxis)
        _require_tuple("bearings", self.bearings, MachineBearing)
        number("sample_rate", self.sample_rate, MachineError)
        names = [axis.name for axis in self.axes]
        if not 1 <= len(names) <= MOST_AXES:
            raise MachineError(f"{len(names)} axes; allowed: 1 to {MOST_AXES}")
        if len(self.bearings) > MOST_AXES:
            raise MachineError(f"{len(self.bearings)} bearings; allowed: up to {MOST_AXES}")
        for name in (self.name, self.source, *names, *(axis.bearing for axis in self.axes), *self._bearing_names):
            require_kind("name", name, str, "a text", MachineError)
            if len(name) > LONGEST_NAME:
                raise MachineError(
                    f"name {bounded(repr(name), LONGEST_NAME)} of {len(name)} characters; allowed: {LONGEST_NAME}"
                )
        if not all(names) or len(set(names)) < len(names):
            raise MachineError(f"axes {', '.join(map(repr, names))}; allowed: a name of its own for each axis")
        bearings = self._bearing_names
        for axis in self.axes:
            if axis.bearing not in bearings:
                there = ", ".join(map(repr, bearings)) or "none"
                raise MachineError(f"axis {axis.name!r} belongs to bearing {axis.bearing!r}; bearings: {there}")
        if not 0.0 < self.sample_rate <= HIGHEST_SAMPLE_RATE:  # not NaN
            raise MachineError(
                f"sample rate {self.sample_rate:g} Hz; allowed: more than 0, up to {HIGHEST_SAMPLE_RATE:g} Hz"
            )

    @property
    def _bearing_names(self) -> list[str]:
        return [bearing.name for bearing in self.bearings]

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Names of the axes, in order."""
        return tuple(axis.name for axis in self.axes)

    @property
    def clearances(self) -> dict[str, float]:
        """Displacement at which the rotor touches the backup bearing (m), by axis where it is known."""
        of_bearing = {bearing.name: bearing.clearance for bearing in self.bearings}
        every = {axis.name: of_bearing[axis.bearing] for axis in self.axes}
        return {axis: clearance for axis, clearance in every.items() if 0.0 < clearance < math.inf}

    def columns_of(self, bearing: str) -> list[int]:
        """The axes of a bearing, as columns of arrays of samples.

        Parameters
        ----------
        bearing : str
            Name of the bearing.

        Returns
        -------
        list of int
            Numbers of its axes, ascending; none for another name.
        """
        return [column for column, axis in enumerate(self.axes) if axis.bearing == bearing]


def _require_tuple(name: str, items: object, kind: type) -> None:
    if not isinstance(items, tuple | list) or not all(isinstance(item, kind) for item in items):
        raise MachineError(f"{name}: {kind_of(items)} is not allowed; allowed: a tuple of {kind.__name__}")


def radial_bearings(record: LoopRecord) -> list[LoopRecord]:
    """The samples of each radial bearing, two axes each, which are a pair by name: x and y, or x_a and y_a.

    An axis without a partner, as that of a thrust bearing, is left out. Two axes are those of one bearing, whatever
    their names.
    """
    if len(record.axes) == 2:
        return [record]
    pairs = [[plane.x, plane.y] for plane in sensor_planes(record.axes)]
    return [
        LoopRecord(
            record.first_step,
            record.sample_time,
            record.reference[:, pair],
            record.position[:, pair],
            record.current[:, pair],
            tuple(record.axes[column] for column in pair),
        )
        for pair in pairs
    ]


def first_bearing(record: LoopRecord) -> LoopRecord:
    """The samples of a machine's first radial bearing, as axes x and y; the record itself if it has only these."""
    if len(record.axes) == 2:
        return record
    reference, position, current = (part[:, :2] for part in (record.reference, record.position, record.current))
    return LoopRecord(record.first_step, record.sample_time, reference, position, current)


DIRECTIONS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Unit vectors of the stator frame: x horizontal, y up, z along the shaft."""

ONE_BEARING = Machine(
    name="one_bearing",
    source="simulator",
    sample_rate=10_000.0,
    axes=tuple(MachineAxis(name, "a", 0.0, 0.0, DIRECTIONS[name], 0.0, math.inf) for name in axis_names(2)),
    bearings=(MachineBearing("a", math.inf),),
)
"""One radial bearing, where only names and directions of axes matter; no claim on its rate, bias or clearance."""
