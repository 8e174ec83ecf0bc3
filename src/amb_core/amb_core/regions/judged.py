"""What a classification could judge at all: a region that was not looked for is not absent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Self

from amb_core.regions.state import Region

NEARLY_ALL = 0.95
"""Share of the updates in which B and C must have been judged for a record to be called free of them."""

MAIN = 0.2
"""Share of the updates that were left out from which their reason is named."""


@dataclass
class TestedUpdates:
    """Updates of one axis by what was done about a drift: covered by a complete test, or left out.

    Those between two changes of the excitation that are too few for a test are not counted, as those of settling.

    Attributes
    ----------
    tested : int
        Covered by a complete test.
    resonant : int
        Left out because the loop follows its input.
    moving : int
        Left out because the reference itself moves slowly.
    unnoticed : float
        How far the bias moved without a drift in any test, if that is `drift_threshold` or more (m).
    """

    tested: int = 0
    resonant: int = 0
    moving: int = 0
    unnoticed: float = 0.0

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The same of several parts of one record."""
        return cls(
            sum(part.tested for part in parts),
            sum(part.resonant for part in parts),
            sum(part.moving for part in parts),
            max(part.unnoticed for part in parts),
        )

    @property
    def left_out(self) -> int:
        """Without a test."""
        return self.resonant + self.moving

    @property
    def evaluated(self) -> int:
        """All of them."""
        return self.tested + self.left_out

    def add(self, points: int, shortest: int) -> None:
        """Count an update whose bias is the latest of `points` in a row; the shortest test needs `shortest`."""
        if points == shortest:
            self.tested += points  # the first complete test covers those before it, too
        elif points > shortest:
            self.tested += 1

    def leave_out(self, updates: int, resonant: bool) -> None:
        """Count updates without a test: at resonance, otherwise while the reference moves slowly."""
        if resonant:
            self.resonant += updates
        else:
            self.moving += updates


class OtherCause(Enum):
    """What a slow line may be, other than a slow oscillation."""

    BEAT = "beat"
    RESPONSE = "response"


@dataclass
class SearchedUpdates:
    """Updates of one axis by what was found of a slow oscillation: whether a slow line may have another cause.

    Attributes
    ----------
    searched : int
        Without a slow line, or with one that counts.
    beating : int
        With a line where the input may beat with the sample rate.
    responding : int
        With a line where the response to an input that is not a sine is not known well enough.
    """

    searched: int = 0
    beating: int = 0
    responding: int = 0

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The same of several parts of one record."""
        return cls(
            sum(part.searched for part in parts),
            sum(part.beating for part in parts),
            sum(part.responding for part in parts),
        )

    @property
    def left_out(self) -> int:
        """With a line that may have another cause."""
        return self.beating + self.responding

    @property
    def evaluated(self) -> int:
        """All of them."""
        return self.searched + self.left_out

    def add(self, cause: OtherCause | None) -> None:
        """Count an update by the other cause that its slow line may have, if any."""
        self.searched += cause is None
        self.beating += cause is OtherCause.BEAT
        self.responding += cause is OtherCause.RESPONSE


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
    oscillation : dict of str to SearchedUpdates
        By axis: in how many updates a slow oscillation (C) could have been found.
    """

    drift: Mapping[str, TestedUpdates]
    contact: Mapping[str, bool]
    resonance_gain: float
    oscillation: Mapping[str, SearchedUpdates] = field(default_factory=dict)

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
        drift = {axis: TestedUpdates.joined([part.drift[axis] for part in parts]) for axis in parts[0].drift}
        oscillation = {
            axis: SearchedUpdates.joined([part.oscillation[axis] for part in parts]) for axis in parts[0].oscillation
        }
        contact = {axis: all(part.contact[axis] for part in parts) for axis in parts[0].contact}
        return cls(drift, contact, parts[0].resonance_gain, oscillation)

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
        return _left_out(self.drift, axis)

    def without_search(self, axis: str | None = None) -> float:
        """Share of the updates in which C was not judged, from 0 to 1.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default the largest share of all.

        Returns
        -------
        float
            The share; 0 if no update was evaluated at all.
        """
        return _left_out(self.oscillation, axis)

    def looked_for(self, axis: str | None = None) -> tuple[Region, ...]:
        """The regions beside A that would have been found.

        Parameters
        ----------
        axis : str, optional
            Name of the axis; by default those that would have been found on every axis.

        Returns
        -------
        tuple of Region
            B and C where they were judged in nearly all updates, and D where the clearance is known. B not where the
            bias moved too slowly for its tests.
        """
        regions = []
        if self.without_drift_test(axis) <= 1.0 - NEARLY_ALL and not self._unnoticed(axis):
            regions.append(Region.B)
        if self.without_search(axis) <= 1.0 - NEARLY_ALL:
            regions.append(Region.C)
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
            The words; `nothing` if no region was looked for.
        """
        names = [region.name for region in self.looked_for(axis)]
        if not names:
            return "nothing"
        *others, last = names
        return f"no {', '.join(others)} or {last}" if others else f"no {last}"

    @property
    def reservations(self) -> tuple[str, ...]:
        """What was not judged and why, in words; empty if everything was."""
        said = _not_judged(Region.B, self.drift, self._no_test)
        slow = [axis for axis in self.drift if self._unnoticed(axis)]
        if slow:
            moved = 1e6 * self._unnoticed(None)
            said.append(
                f"slow drifts not judged ({', '.join(slow)}): the bias moved by {moved:.3g} um, too slowly for B"
            )
        said += _not_judged(Region.C, self.oscillation, self._no_search)
        unknown = [axis for axis, known in self.contact.items() if not known]
        if unknown:
            where = "" if len(unknown) == len(self.contact) else f" ({', '.join(unknown)})"
            said.append(f"D not judged{where}: the clearance is not known")
        return tuple(said)

    def _unnoticed(self, axis: str | None) -> float:
        """How far the bias of an axis moved too slowly for B (m); by default the largest value of all."""
        return max((counted.unnoticed for name, counted in self.drift.items() if axis in (None, name)), default=0.0)

    def _no_test(self, axes: Sequence[str]) -> str:
        """Why B was not judged on axes."""
        return _main_reasons(
            {
                f"the response is at {self.resonance_gain:g} of the input or more (resonant)": sum(
                    self.drift[axis].resonant for axis in axes
                ),
                "the reference itself moves slowly": sum(self.drift[axis].moving for axis in axes),
            }
        )

    def _no_search(self, axes: Sequence[str]) -> str:
        """Why C was not judged on axes."""
        return _main_reasons(
            {
                "a slow line may be a beat of the input with the sample rate": sum(
                    self.oscillation[axis].beating for axis in axes
                ),
                "a slow line may be a response, since the input is not a sine": sum(
                    self.oscillation[axis].responding for axis in axes
                ),
            }
        )

    @property
    def as_dict(self) -> dict[str, object]:
        """Plain values: shares of the updates without a test for B and C by axis, axes without one for D, in words."""
        return {
            "B": {axis: self.without_drift_test(axis) for axis in self.drift},
            "C": {axis: self.without_search(axis) for axis in self.oscillation},
            "D": [axis for axis, known in self.contact.items() if not known],
            "reasons": list(self.reservations),
        }


def _left_out(counts: Mapping[str, TestedUpdates] | Mapping[str, SearchedUpdates], axis: str | None) -> float:
    """Share of the updates of an axis in which a region was not judged; by default the largest share of all."""
    shares = (
        counted.left_out / counted.evaluated if counted.evaluated else 0.0
        for name, counted in counts.items()
        if axis in (None, name)
    )
    return max(shares, default=0.0)


def _not_judged(
    region: Region,
    counts: Mapping[str, TestedUpdates] | Mapping[str, SearchedUpdates],
    reason: Callable[[Sequence[str]], str],
) -> list[str]:
    """The reservation about a region that was not judged in nearly all updates, if there is one."""
    axes = [axis for axis in counts if _left_out(counts, axis) > 1.0 - NEARLY_ALL]
    if not axes:
        return []
    share = 100.0 * _left_out(counts, None)
    return [f"{region.name} not judged in {share:.0f} % of the record ({', '.join(axes)}): {reason(axes)}"]


def _main_reasons(updates: Mapping[str, int]) -> str:
    """The reasons without those that are rare, by the updates that were left out for each."""
    total = sum(updates.values())
    return "; ".join(reason for reason, count in updates.items() if count >= MAIN * total)
