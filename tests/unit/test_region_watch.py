"""What the region monitor makes of telemetry, without ROS: runs, gaps, delevitation, and what is worth telling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from amb_core.errors import RegionError
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region, RegionParameters, RegionState
from amb_ident_node.monitoring import RegionWatch

STEPS = 6_000


@pytest.fixture
def quiet() -> LoopRecord:
    position = 1e-8 * np.random.default_rng(1).normal(size=(STEPS, 2))
    return LoopRecord(0, 1e-4, np.zeros((STEPS, 2)), position, np.zeros((STEPS, 2)))


@pytest.fixture
def watch() -> RegionWatch:
    return RegionWatch(RegionParameters(), publish_period=0.05)


def test_a_quiet_loop_is_told_once_a_period_and_when_it_has_settled(watch: RegionWatch, quiet: LoopRecord) -> None:
    states = watch.add_block(7, quiet)
    assert watch.run == 7
    assert {state.region for state in states} == {Region.A}
    settled = next(state.step for state in states if state.settled)
    assert [state.step for state in states] == sorted({99, settled, *range(499, STEPS, 500)})


def test_delevitation_is_told_after_the_last_sample_whichever_comes_first(quiet: LoopRecord) -> None:
    told = []
    for telemetry_first in (True, False):
        watch = RegionWatch(RegionParameters(), publish_period=0.05)
        states: list[RegionState] = []
        if telemetry_first:
            states += watch.add_block(7, quiet)
            states += watch.delevitate(7, STEPS)
        else:
            states += watch.delevitate(7, STEPS)
            states += watch.add_block(7, quiet.window(0, 4_000))
            assert {state.region for state in states} == {Region.A}, "its last samples are still to come"
            states += watch.add_block(7, quiet.window(4_000, 2_000))
        assert (states[-1].region, states[-1].since.step) == (Region.D, STEPS)
        told.append([(state.step, state.region) for state in states])
    assert told[0] == told[1]


def test_delevitation_of_another_run_does_not_count(watch: RegionWatch, quiet: LoopRecord) -> None:
    watch.delevitate(6, STEPS)
    assert watch.add_block(7, quiet)[-1].region == Region.A


def test_a_new_run_starts_afresh_and_forgets_what_was_wrong(watch: RegionWatch, quiet: LoopRecord) -> None:
    first = watch.add_block(7, quiet)
    watch.add_block(7, quiet.window(1_000, 500))
    assert watch.restarts == 1
    assert watch.problem.startswith("telemetry goes back from step 5999 to step 1000 of run 7")
    assert repr(watch.add_block(8, quiet)) == repr(first)
    assert (watch.run, watch.problem) == (8, "")


def test_a_block_that_cannot_be_classified_is_left_out(watch: RegionWatch, quiet: LoopRecord) -> None:
    position = quiet.position.copy()
    position[2_100, 0] = math.inf
    broken = LoopRecord(0, 1e-4, quiet.reference, position, quiet.current)
    watch.add_block(7, broken.window(0, 2_000))
    with pytest.raises(RegionError, match="position x is inf at step 2100"):
        watch.add_block(7, broken.window(2_000, 1_000))
    assert (watch.refused, watch.problem) == (1, "telemetry: position x is inf at step 2100; samples must be finite")
    watch.add_block(7, broken.window(3_000, 3_000))
    assert watch.restarts == 1
    assert "lacks steps 2000 to 2999 of run 7" in watch.problem


def test_a_sample_time_too_long_for_the_classifier_is_refused(watch: RegionWatch, quiet: LoopRecord) -> None:
    slow = LoopRecord(0, 1e-2, quiet.reference, quiet.position, quiet.current)
    for _ in range(2):
        with pytest.raises(RegionError, match="update_interval"):
            watch.add_block(7, slow)
    assert watch.state is None
    assert watch.add_block(8, quiet), "the next run is judged"
