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

    A stretch begins at the estimated onset of its region, which is earlier than the state that first reports it. After
    a higher region it begins when that one ends: its onset may lie before it, or even before the higher one. The time
    before B and C can first be found counts as A if it turns out to be A. It is left out if it ends before.
    """
    joined: list[Stretch] = []
    for state in states:
        if state.region is Region.A and not state.settled:
            continue
        first, stop = state.since.step, state.step + 1
        if joined and state.region < joined[-1].region:
            first = max(first, joined[-1].stop)  # a region that the higher one only hid continues after it
        while joined and joined[-1].region != state.region and joined[-1].first_step >= first:
            joined.pop()  # remove all of it: the new region began even earlier
        if joined and joined[-1].region == state.region and joined[-1].stop >= first:
            joined[-1] = Stretch(state.region, joined[-1].first_step, stop)
            continue
        if joined:
            joined[-1] = Stretch(joined[-1].region, joined[-1].first_step, min(first, joined[-1].stop))
        joined.append(Stretch(state.region, first, stop))
    return joined


def shares(parts: Sequence[Stretch]) -> dict[Region, float]:
    """Share of the time in each region, from 0 to 1; all zero if nothing was classified."""
    steps = dict.fromkeys(Region, 0)
    for stretch in parts:
        steps[stretch.region] += stretch.stop - stretch.first_step
    total = max(sum(steps.values()), 1)
    return {region: count / total for region, count in steps.items()}


def beats(states: Sequence[RegionState]) -> list[tuple[int, int]]:
    """Spans (first step, last step) of states in which the input of an axis beat with the sample rate."""
    beating = [state.sampling_beat for state in states]
    edges = np.flatnonzero(np.diff([False, *beating, False]))
    return [(states[first].step, states[last - 1].step) for first, last in zip(edges[::2], edges[1::2], strict=True)]
