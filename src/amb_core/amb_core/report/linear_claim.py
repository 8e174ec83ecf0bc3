"""Whether region A may be said of a record: not where a region was not looked for, nor where a sensor stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from amb_core.regions import Classification, Judged, Region

NONE_FOUND = "none found"
"""What stands in the place of region A where A may not be said."""


@dataclass(frozen=True)
class LinearClaim:
    """What may be said where none of B, C and D was found.

    Attributes
    ----------
    judged : Judged
        What was looked for.
    still : tuple of str
        Axes whose position stands still while they move: a dead or stuck sensor shows no region.
    """

    judged: Judged
    still: tuple[str, ...]

    @classmethod
    def of(cls, classification: Classification, frozen: Sequence[str] = ()) -> Self:
        """What may be said of a classification.

        Parameters
        ----------
        classification : Classification
            Of a record.
        frozen : sequence of str, optional
            Positions that keep one value while their axis moves, as `RecordedRegions.frozen` names them, such as
            `x steps 400 to 900`. Those that the states of the classification show count in any case.
        """
        still = [
            axis
            for column, axis in enumerate(classification.axis_onsets)
            if any(state.axes[column].frozen for state in classification.states)
            or any(place.startswith(f"{axis} steps ") for place in frozen)
        ]
        return cls(classification.judged, tuple(still))

    def holds(self, axis: str | None = None) -> bool:
        """Whether A may be said of an axis, by default of the rotor."""
        return self.judged.complete(axis) and not self._still(axis)

    @property
    def looked_for(self) -> tuple[Region, ...]:
        """The regions that the rotor does not have if they were not found."""
        return () if self.still else self.judged.looked_for()

    @property
    def name(self) -> str:
        """The letter A of the rotor, or what stands in its place."""
        return Region.A.name if self.holds() else NONE_FOUND

    def absent(self, axis: str | None = None) -> str:
        """The regions that were looked for and not found, such as `no B or C`; of a sensor that stands still, that."""
        if still := self._still(axis):
            return f"sensor of {', '.join(still)} dead or stuck"
        return self.judged.absent(axis)

    @property
    def still_problem(self) -> str:
        """What positions that stand still mean, in words; empty without any."""
        if not self.still:
            return ""
        return (
            f"position {', '.join(self.still)}: unchanged while its axis moves; a dead or stuck sensor shows no region"
        )

    @property
    def reservations(self) -> tuple[str, ...]:
        """Why A may not be said of the rotor, in words; empty if it may."""
        return (*filter(None, [self.still_problem]), *self.judged.reservations)

    def _still(self, axis: str | None) -> tuple[str, ...]:
        return tuple(name for name in self.still if axis in (None, name))
