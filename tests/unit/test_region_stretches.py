"""Stretches of one region from the states of a run: begun at their onsets, interrupted by gaps, shared out by time."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from amb_core.regions import AxisState, Onset, Region, RegionState
from amb_core.regions.stretches import Stretch, beats, shares, stretches

INTERVAL = 100


def state(step: int, region: Region, since: int, settled: bool = True, beat: bool = False) -> RegionState:
    onset = Onset(since, since * 1e-4, math.nan, False)
    axis = AxisState(region, onset, *[0.0] * 8, sampling_beat=beat)
    return RegionState(step, (axis, axis), (), region, onset, 0.0, settled)


def run(regions: str, first_step: int = 0, onsets: dict[str, int] | None = None) -> list[RegionState]:
    """States of gapless telemetry, one a letter; `-` is A before it is settled."""
    since = {"A": first_step, "-": first_step, **(onsets or {})}
    return [
        state(first_step + INTERVAL * (n + 1) - 1, Region[letter.replace("-", "A")], since[letter], letter != "-")
        for n, letter in enumerate(regions)
    ]


def test_a_stretch_begins_at_its_onset_not_when_it_was_noticed() -> None:
    assert stretches(run("--AAABBBDD", onsets={"B": 420, "D": 790})) == [
        Stretch(Region.A, 0, 420),
        Stretch(Region.B, 420, 790),
        Stretch(Region.D, 790, 1000),
    ]


def test_a_region_that_began_before_the_last_one_takes_its_place() -> None:
    assert stretches(run("AABBCC", onsets={"B": 180, "C": 150})) == [
        Stretch(Region.A, 0, 150),
        Stretch(Region.C, 150, 600),
    ]


def test_a_region_that_a_higher_one_hid_continues_after_it() -> None:
    assert stretches(run("AABBCCBB", onsets={"B": 200, "C": 400})) == [
        Stretch(Region.A, 0, 200),
        Stretch(Region.B, 200, 400),
        Stretch(Region.C, 400, 600),
        Stretch(Region.B, 600, 800),
    ]


def test_nothing_is_said_about_a_gap_nor_about_what_was_never_judged() -> None:
    before, after = run("AAA"), run("-AA", first_step=1000)
    assert stretches(before + after) == [Stretch(Region.A, 0, 300), Stretch(Region.A, 1000, 1300)]
    assert stretches(run("---")) == []


def test_shares_are_those_of_the_time_judged() -> None:
    by_region = shares([Stretch(Region.A, 0, 300), Stretch(Region.B, 1000, 1100)])
    assert by_region == pytest.approx({Region.A: 0.75, Region.B: 0.25, Region.C: 0.0, Region.D: 0.0})
    assert set(shares([]).values()) == {0.0}


def test_beats_are_spans_of_states() -> None:
    states = run("AAAAAA")
    for n in (1, 2, 5):
        still, beating = states[n].axes[0], replace(states[n].axes[1], sampling_beat=True)
        states[n] = replace(states[n], axes=(still, beating))
    assert beats(states) == [(199, 299), (599, 599)]
