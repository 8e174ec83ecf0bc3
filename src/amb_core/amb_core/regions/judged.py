"""What a classification could judge at all: a region that was not looked for is not absent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from amb_core.regions.state import Region

NEARLY_ALL = 0.95
"""Share of the updates in which B must have been judged for a record to be called free of it."""


@dataclass
class TestedUpdates:
    """Updates of one axis after settling, and those of them that a complete test for a drift covers."""

    evaluated: int = 0
    tested: int = 0

    def add(self, points: int, shortest: int) -> None:
        """Count an update whose bias is the latest of `points` in a row; the shortest test needs `shortest`."""
        self.evaluated += 1
        if points == shortest:
            self.tested += points  # the first complete test covers those before it, too
        elif points > shortest:
            self.tested += 1

    def leave_out(self) -> None:
        """Count an update whose bias is not looked at."""
        self.evaluated += 1


@dataclass(frozen=True)
class Judged:
    """What was judged in a record.

    Attributes
    ----------
    drift : dict of str to TestedUpdates
        By axis: in how many updates a drift of the bias (B) could have been found.
    contact : dict of str to bool
        By axis: whether the clearance of its bearing is known, without which D is not judged.
    resonance_gain : float
        Response per input (-) at or above which B is not judged.
    """

    drift: Mapping[str, TestedUpdates]
    contact: Mapping[str, bool]
    resonance_gain: float

    @classmethod
    def joined(cls, parts: Sequence[Judged]) -> Judged:
        """The same of several parts of one record.

        Parameters
        ----------
        parts : sequence of Judged
            At least one, all of the same axes.

        Returns
        -------
        Judged
            With the updates of all.
        """
        drift = {
            axis: TestedUpdates(
                sum(part.drift[axis].evaluated for part in parts), sum(part.drift[axis].tested for part in parts)
            )
            for axis in parts[0].drift
        }
        contact = {axis: all(part.contact[axis] for part in parts) for axis in parts[0].contact}
        return cls(drift, contact, parts[0].resonance_gain)

    def without_drift_test(self, axis: str | None = None) -> float:
        """Share of the updates in which B was not judged, from 0 to 1.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default the largest share of all.

        Returns
        -------
        float
            The share; 0 if no update was evaluated at all.
        """
        if axis is None:
            return max((self.without_drift_test(name) for name in self.drift), default=0.0)
        counted = self.drift[axis]
        return 1.0 - counted.tested / counted.evaluated if counted.evaluated else 0.0

    def looked_for(self, axis: str | None = None) -> tuple[Region, ...]:
        """The regions beside A that would have been found.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default those that would have been found on every axis.

        Returns
        -------
        tuple of Region
            B where it was judged in nearly all updates, C, and D where the clearance is known.
        """
        regions = [Region.C]
        if self.without_drift_test(axis) <= 1.0 - NEARLY_ALL:
            regions.insert(0, Region.B)
        if all(self.contact.values()) if axis is None else self.contact[axis]:
            regions.append(Region.D)
        return tuple(regions)

    def complete(self, axis: str | None = None) -> bool:
        """Whether all regions were looked for, so that A may be said where none was found.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default all.

        Returns
        -------
        bool
            Whether B, C and D were judged.
        """
        return len(self.looked_for(axis)) == len(Region) - 1

    def absent(self, axis: str | None = None) -> str:
        """The regions that were looked for and not found, in words, such as `no B or C`.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default all.

        Returns
        -------
        str
            The words.
        """
        *others, last = (region.name for region in self.looked_for(axis))
        return f"no {', '.join(others)} or {last}" if others else f"no {last}"

    @property
    def reservations(self) -> tuple[str, ...]:
        """What was not judged and why, in words; empty if everything was."""
        said = []
        left_out = [axis for axis in self.drift if self.without_drift_test(axis) > 1.0 - NEARLY_ALL]
        if left_out:
            said.append(
                f"B not judged in {100.0 * self.without_drift_test():.0f} % of the record ({', '.join(left_out)}): the "
                f"response is at {self.resonance_gain:g} of the input or more (resonant)"
            )
        unknown = [axis for axis, known in self.contact.items() if not known]
        if unknown:
            where = "" if len(unknown) == len(self.contact) else f" ({', '.join(unknown)})"
            said.append(f"D not judged{where}: the clearance is not known")
        return tuple(said)

    @property
    def as_dict(self) -> dict[str, object]:
        """Plain values: the share of the updates without a test for B by axis, the axes without one for D, in words."""
        return {
            "B": {axis: self.without_drift_test(axis) for axis in self.drift},
            "D": [axis for axis, known in self.contact.items() if not known],
            "reasons": list(self.reservations),
        }
