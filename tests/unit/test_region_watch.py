"""What the region monitor makes of telemetry, without ROS: runs, gaps, delevitation, and what is worth telling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from amb_core.ground.errors import RegionError
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord, axis_names
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


def test_a_later_run_is_awaited_until_its_telemetry_comes(watch: RegionWatch, quiet: LoopRecord) -> None:
    watch.add_block(7, quiet.window(0, 3_000))
    watch.begin(7)
    assert watch.awaited is None
    watch.begin(8)
    watch.add_block(7, quiet.window(3_000, 3_000))
    assert (watch.run, watch.awaited) == (7, 8), "the rest of the run before it comes late"
    watch.add_block(8, quiet)
    assert (watch.run, watch.awaited) == (8, None)
    watch.begin(7)
    assert watch.awaited is None, "which is older"


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
    slow = LoopRecord(0, 2e-2, quiet.reference, quiet.position, quiet.current)
    for _ in range(2):
        with pytest.raises(RegionError, match="not classified at 50 Hz; the sample rate must be at least 100 Hz"):
            watch.add_block(7, slow)
    assert watch.state is None
    assert watch.add_block(8, quiet), "the next run is judged"


# -- the machine


def machine(axes: int = 4, clearance: float = 200e-6) -> Machine:
    names = axis_names(axes)
    bearings = [name[2:] or "a" for name in names]
    return Machine(
        "rig",
        "bridge",
        1e4,
        tuple(
            MachineAxis(name, bearing, 0.0, 0.0, (1.0, 0.0, 0.0), 3.0, 3.0)
            for name, bearing in zip(names, bearings, strict=True)
        ),
        tuple(MachineBearing(name, clearance) for name in dict.fromkeys(bearings)),
    )


@pytest.fixture
def touching() -> LoopRecord:
    """Four axes, of which y_b goes 220 um from the centre at the end."""
    position = 1e-8 * np.random.default_rng(1).normal(size=(STEPS, 4))
    position[-500:, 3] = 220e-6
    return LoopRecord(0, 1e-4, np.zeros((STEPS, 4)), position, np.zeros((STEPS, 4)))


def test_a_bearing_is_judged_by_the_clearance_of_the_machine(watch: RegionWatch, touching: LoopRecord) -> None:
    watch.use(machine())
    state = watch.add_block(7, touching)[-1]
    assert [(bearing.name, bearing.region) for bearing in state.bearings] == [("a", Region.A), ("b", Region.D)]
    assert (state.region, watch.machine_problem) == (Region.D, "")


def test_a_run_without_its_machine_has_bearings_by_names(watch: RegionWatch, touching: LoopRecord) -> None:
    watch.use(machine(2))
    state = watch.add_block(7, touching)[-1]
    assert [axis.name for axis in state.axes] == ["x_a", "y_a", "x_b", "y_b"]
    assert state.region is not Region.D
    assert watch.machine_problem == (
        "run 7 is classified without its machine, with bearings by the names of the axes (a: x_a, y_a; b: x_b, y_b)"
        "; D not judged: the clearance is not known"
    )
    assert watch.not_judged == "D not judged: the clearance is not known"


def test_a_machine_that_changes_holds_from_the_next_run_on(watch: RegionWatch, touching: LoopRecord) -> None:
    watch.use(machine(clearance=250e-6))
    watch.add_block(7, touching.window(0, 2_000))
    watch.use(machine(clearance=200e-6))
    assert watch.machine_problem == "", "the run may be over"
    states = watch.add_block(7, touching.window(2_000, 4_000))
    assert states[-1].region is not Region.D
    assert watch.machine_problem.startswith("the machine changed within run 7")
    assert watch.add_block(8, touching)[-1].region is Region.D
    assert watch.machine_problem == ""


def test_other_axes_within_a_run_are_refused(watch: RegionWatch, quiet: LoopRecord, touching: LoopRecord) -> None:
    watch.add_block(7, touching.window(0, 2_000))
    with pytest.raises(RegionError, match="the axes are x, y at step 2000; the classifier was made for x_a"):
        watch.add_block(7, quiet.window(2_000, 100))
    assert watch.refused == 1
