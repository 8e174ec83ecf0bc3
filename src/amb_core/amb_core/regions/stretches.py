"""Stretches of a record that ran in one region, and the share of time in each region."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from amb_core.regions.state import Region, RegionState


@dataclass(frozen=True)
class Stretch:
    """Consecutive steps in one region of the rotor: from `first_step` up to, not including, `stop`."""

    region: Region
    first_step: int
    stop: int


def stretches(states: Sequence[RegionState]) -> list[Stretch]:
    """The stretches that the states of gapless telemetry tell of, in order.

    A stretch begins at the estimated onset of its region, which is earlier than the state that first told of it. What
    comes before B and C are judged for the first time counts as A if it turns out to be, and is left out if it is never
    judged.
    """
    found: list[Stretch] = []
    for state in states:
        if state.region is Region.A and not state.settled:
            continue
        first, stop = state.since.step, state.step + 1
        while found and found[-1].first_step >= first and found[-1].region != state.region:
            found.pop()  # all of it is taken back: the region began even earlier
        if found and found[-1].region == state.region:
            found[-1] = Stretch(state.region, found[-1].first_step, stop)
            continue
        if found:
            found[-1] = Stretch(found[-1].region, found[-1].first_step, first)
        found.append(Stretch(state.region, first, stop))
    return found


def shares(found: Sequence[Stretch]) -> dict[Region, float]:
    """Share of the time in each region, from 0 to 1; all zero where nothing was judged."""
    steps = dict.fromkeys(Region, 0)
    for stretch in found:
        steps[stretch.region] += stretch.stop - stretch.first_step
    total = max(sum(steps.values()), 1)
    return {region: count / total for region, count in steps.items()}
