"""Regions over a whole run: stretches of one region, shares of the time, spans of beating."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from amb_core.regions import Region, RegionState


@dataclass(frozen=True)
class Stretch:
    """Consecutive steps in one region of the rotor: from `first_step` up to, not including, `stop`."""

    region: Region
    first_step: int
    stop: int


def stretches(states: Sequence[RegionState]) -> list[Stretch]:
    """The stretches in the states of a run, in order; between them are gaps in the telemetry.

    A stretch begins at the estimated onset of its region, which is earlier than the state that first reports it. The
    time before B and C are first classified counts as A if it turns out to be A. It is left out if they are never
    classified.
    """
    found: list[Stretch] = []
    for state in states:
        if state.region is Region.A and not state.settled:
            continue
        first, stop = state.since.step, state.step + 1
        while found and found[-1].region != state.region and found[-1].first_step >= first:
            found.pop()  # remove all of it: the new region began even earlier
        if found and found[-1].region == state.region and found[-1].stop >= first:
            found[-1] = Stretch(state.region, found[-1].first_step, stop)
            continue
        if found:
            found[-1] = Stretch(found[-1].region, found[-1].first_step, min(first, found[-1].stop))
        found.append(Stretch(state.region, first, stop))
    return found


def shares(found: Sequence[Stretch]) -> dict[Region, float]:
    """Share of the time in each region, from 0 to 1; all zero if nothing was classified."""
    steps = dict.fromkeys(Region, 0)
    for stretch in found:
        steps[stretch.region] += stretch.stop - stretch.first_step
    total = max(sum(steps.values()), 1)
    return {region: count / total for region, count in steps.items()}


def beats(states: Sequence[RegionState]) -> list[tuple[int, int]]:
    """Spans (first step, last step) of states in which the input of an axis beat with the sample rate."""
    beating = [state.sampling_beat for state in states]
    edges = np.flatnonzero(np.diff([False, *beating, False]))
    return [(states[first].step, states[last - 1].step) for first, last in zip(edges[::2], edges[1::2], strict=True)]
