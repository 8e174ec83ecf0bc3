"""Runs, trips and protection of a rig, from telemetry and status of a target."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.ground.parameters import validate
from amb_core.loop.allowed_changes import AllowedChanges
from amb_core.loop.machine import ONE_BEARING, MachineBearing
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.rig import BridgeTrip, ExcitationProtection, ProtectionParameters, Runs, RunSamples, TripLog, describe
from amb_core.rig.link import ExcitationPhase, Limits, TargetState, TargetStatus, TelemetryBlock, Trip, TripReason
from amb_core.rig.trips import _TEXTS
from amb_sim_node.bridge_parameters import BridgeParameters
from tests.target_rig import machine

OFF, LEVITATED, TRIPPED = (int(state) for state in (TargetState.OFF, TargetState.LEVITATED, TargetState.TRIPPED))
BLOCK = 100


def samples(first: int, states: list[int]) -> TelemetryBlock:
    """Samples whose position is their step."""
    steps = np.arange(first, first + len(states), dtype=float)
    columns = np.column_stack([steps, -steps])
    return TelemetryBlock(first, 0, 2 * columns, columns, 3 * columns, None, np.array(states, np.uint32) | 0x100)


def runs() -> Runs:
    return Runs(machine(), BLOCK, itertools.count(1).__next__)


def joined(blocks: list[RunSamples]) -> dict[int, list[LoopRecord]]:
    by_run: dict[int, list[LoopRecord]] = {}
    for block in blocks:
        by_run.setdefault(block.run, []).append(block.record)
    return by_run


def test_a_run_begins_with_the_first_levitated_step_and_ends_with_the_last() -> None:
    taken = runs()
    done = taken.add(samples(0, [OFF] * 30 + [LEVITATED] * 250)) + taken.add(samples(280, [LEVITATED] * 15 + [OFF] * 5))
    ((run, records),) = joined(done).items()
    assert run == 1
    assert [(record.first_step, record.steps) for record in records] == [(0, 100), (100, 100), (200, 65)]
    position = np.concatenate([record.position for record in records])
    assert np.array_equal(position[:, 0], np.arange(30, 295))
    assert np.array_equal(np.concatenate([record.current for record in records]), 3 * position)
    assert not taken.levitated
    assert (taken.next_target_step, taken.position[0]) == (300, 299.0)


def test_each_levitation_is_a_run_of_its_own() -> None:
    taken = runs()
    done = taken.add(samples(0, [LEVITATED] * 10 + [TRIPPED] * 3 + [OFF] * 3 + [LEVITATED] * 20))
    done += taken.end()
    assert {run: sum(record.steps for record in records) for run, records in joined(done).items()} == {1: 10, 2: 20}


def test_a_step_is_of_the_run_though_its_samples_were_lost() -> None:
    taken = runs()
    taken.add(samples(50, [LEVITATED] * 10))
    assert [taken.holds(step) for step in (49, 50, 60, 75)] == [False, True, True, True]
    taken.add(samples(70, [TRIPPED] * 3))
    assert [taken.holds(step) for step in (49, 50, 70, 71)] == [False, True, True, False]


@pytest.mark.parametrize("frame", [1, 7, 13, 27, 300])
def test_blocks_do_not_depend_on_the_size_of_frames(frame: int) -> None:
    taken = runs()
    done: list[RunSamples] = []
    for first in range(0, 1000, frame):
        done += taken.add(samples(first, [LEVITATED] * min(frame, 1000 - first)))
    done += taken.end()
    assert [block.record.first_step for block in done] == list(range(0, 1000, BLOCK))
    assert np.array_equal(np.concatenate([block.record.position[:, 0] for block in done]), np.arange(1000))


def test_a_gap_ends_a_block_and_the_next_ones_begin_where_they_would_have() -> None:
    taken = runs()
    done = taken.add(samples(0, [LEVITATED] * 130)) + taken.add(samples(145, [LEVITATED] * 200)) + taken.end()
    places = [(block.record.first_step, block.record.steps) for block in done]
    assert places == [(0, 100), (100, 30), (145, 55), (200, 100), (300, 45)]


def test_the_second_before_a_step_is_kept_within_its_run() -> None:
    taken = runs()
    taken.add(samples(0, [LEVITATED] * 500 + [OFF] * 10 + [LEVITATED] * 12_000 + [TRIPPED] * 20))
    before = taken.before(12_510)
    assert sum(record.steps for record in before) == 10_000
    assert (before[0].first_step, before[-1].first_step + before[-1].steps) == (2_000, 12_000)
    assert np.array_equal(np.concatenate([record.position[:, 0] for record in before]), np.arange(2_510, 12_510))


def test_what_is_missing_of_the_second_before_a_step_is_named() -> None:
    taken = runs()
    for first in range(0, 9_000, 100):
        taken.add(samples(first, [LEVITATED] * 100))
    assert taken.lacking_before(9_000) == ""
    taken.add(samples(9_500, [LEVITATED] * 500))  # after a gap
    assert taken.lacking_before(10_000) == "500 of the 10000 steps before it are missing here"
    for first in range(10_000, 60_000, 100):  # news that come four seconds late
        taken.add(samples(first, [LEVITATED] * 100))
    assert taken.lacking_before(20_000) == "10000 of the 10000 steps before it are missing here"


def test_the_second_before_a_step_is_there_although_it_becomes_known_two_seconds_later() -> None:
    taken = runs()
    for first in range(0, 32_000, 1_000):
        taken.add(samples(first, [LEVITATED] * 1_000))
    before = taken.before(12_000)
    assert np.array_equal(np.concatenate([record.position[:, 0] for record in before]), np.arange(2_000, 12_000))


@pytest.mark.parametrize("lost", [(200, 10_200), (9_700, 10_200), (2_000, 5_000), (200, 300)])
def test_the_record_of_the_target_fills_the_gaps_of_telemetry_and_nothing_else(lost: tuple[int, int]) -> None:
    taken = runs()
    taken.add(samples(0, [OFF] * 100 + [LEVITATED] * 100))
    for first in range(200, 10_200, 100):
        if not lost[0] <= first < lost[1]:
            taken.add(samples(first, [LEVITATED] * 100))
    kept = [samples(first, [LEVITATED] * 70) for first in range(180, 10_180, 70)]
    kept = [replace(block, position=block.position + 0.5) for block in kept]
    gap = "10 of the 10000 steps before it are missing here" if lost[1] == 10_200 else ""
    assert taken.lacking_before(10_200)
    assert taken.lacking_before(10_200, kept) == gap
    before = taken.before(10_200, kept)
    steps = np.concatenate([100 + np.arange(record.first_step, record.first_step + record.steps) for record in before])
    filled = (steps >= lost[0]) & (steps < lost[1])
    assert np.array_equal(np.concatenate([record.position[:, 0] for record in before]), steps + 0.5 * filled)
    assert (steps[0], len(steps)) == (200, 9_990 if gap else 10_000)


def status(*trips: Trip) -> TargetStatus:
    state = TargetState.TRIPPED if trips else TargetState.LEVITATED
    return TargetStatus(
        0, state, ExcitationPhase.NONE, False, False, True, False, False, 0, 0, 0, 0, 0, 0, trips
    )  # fmt: skip


def test_a_trip_is_reported_once_when_telemetry_has_reached_it_or_after_a_while() -> None:
    log, trip = TripLog(), Trip(TripReason.SENSOR_STUCK, 700, 1, 5e-6)
    assert log.note(status(trip), now=0.0)
    assert not log.note(status(trip), now=0.1)
    assert log.ready(699, now=0.1) == []
    assert log.ready(700, now=0.1) == [trip]
    assert log.ready(900, now=9.0) == []
    late = Trip(TripReason.AMPLIFIER, 800, 0, 0.0)
    assert log.note(status(trip, late), now=1.0)
    assert log.ready(750, now=1.0 + 2 * log.PATIENCE) == [late]
    assert log.latched == [trip, late]


def test_after_a_reset_the_same_trip_is_a_new_one() -> None:
    log, trip = TripLog(), Trip(TripReason.AMPLIFIER, 700, 0, 0.0)
    log.note(status(trip), 0.0)
    log.ready(1000, 0.0)
    assert not log.note(status(), 0.0)
    assert log.note(status(Trip(TripReason.AMPLIFIER, 900, 0, 0.0)), 0.0)


def test_every_reason_has_a_text() -> None:
    assert set(_TEXTS) == {int(reason) for reason in (*TripReason, *BridgeTrip)}
    for reason in TripReason:
        assert "{" not in describe(Trip(reason, 1, 1, 0.6), machine())
    assert describe(Trip(TripReason.DISPLACEMENT, 1, 1, 0.6), machine()).endswith("60 % of the clearance")
    assert "y_0" in describe(Trip(TripReason.SENSOR_STUCK, 1, 1, 2e-6), machine())


BEARING = replace(ONE_BEARING, bearings=(MachineBearing("a", 250e-6),))
CENTRE = np.zeros(2)


def protection(**parameters: float) -> ExcitationProtection:
    given = ProtectionParameters(**parameters)
    limits = given.lowered(Limits(excitation_amplitude=50e-6, excitation_slew=0.1), current_limit=3.0)
    return ExcitationProtection(given, limits, BEARING, room=100_000)


def sine(frequency: float, amplitude: float, steps: int = 10_000) -> np.ndarray:
    signal = np.zeros((steps, 2))
    signal[:, 1] = amplitude * np.sin(2 * np.pi * frequency * np.arange(steps) / 10_000.0)
    return signal


def test_what_is_within_all_limits_passes() -> None:
    protection(lowest_frequency=50.0, highest_frequency=200.0).require(sine(100.0, 40e-6), CENTRE)


def test_an_excitation_that_would_take_the_rotor_to_the_alarm_from_where_it_is_is_refused() -> None:
    with pytest.raises(ExcitationError, match=r"108 um from the centre of bearing a; allowed on this rig: 100 um"):
        protection().require(sine(100.0, 40e-6), np.array([0.0, -68e-6]))
    with pytest.raises(ExcitationError, match="from the centre of bearing a"):  # radially: 72 um on each axis
        protection().require(np.repeat(sine(100.0, 4e-6)[:, 1:], 2, axis=1), np.array([70e-6, 70e-6]))


@pytest.mark.parametrize(
    ("signal", "parameters", "reason"),
    [
        (sine(10.0, 60e-6), {}, r"amplitude of 60 um on y; allowed on this rig: 50 um"),
        (sine(10.0, 20e-6), {"excitation_amplitude": 10e-6}, r"allowed on this rig: 10 um"),
        (sine(1000.0, 40e-6), {}, r"slew of .* mm/s on y; allowed on this rig: 100 mm/s"),
        (np.full((10, 2), 20e-6), {}, r"slew of 200 mm/s on x"),  # from zero and back to it
        (sine(300.0, 10e-6), {"highest_frequency": 200.0}, r"% of its power on y lies outside of 0 to 200 Hz"),
        (sine(10.0, 10e-6), {"lowest_frequency": 20.0}, r"outside of 20 to 5000 Hz"),
        (sine(10.0, 10e-6), {"longest_excitation": 0.5}, r"1 s long; allowed on this rig: 0.5 s \(the limit longest"),
        (sine(10.0, 10e-6, 100_001), {}, r"10.0001 s long; allowed on this rig: 10 s \(room for it on the target"),
    ],
)
def test_what_exceeds_a_limit_is_refused_with_value_axis_and_limit(
    signal: np.ndarray, parameters: dict[str, float], reason: str
) -> None:
    with pytest.raises(ExcitationError, match=reason):
        protection(**parameters).require(signal, CENTRE)


def test_limits_of_the_host_only_lower_those_of_the_target() -> None:
    own = Limits(alarm_share=0.3, excitation_amplitude=1e-6)
    lowered = ProtectionParameters(excitation_amplitude=1e-3).lowered(own, current_limit=99.0)
    assert lowered == own
    assert ProtectionParameters().lowered(own, current_limit=1.0).control_current == 1.0


def test_an_alarm_after_the_trip_is_refused_when_it_is_set() -> None:
    with pytest.raises(ParameterError, match=r"protection.*alarm_share = 0\.6 is above trip_share = 0\.5; allowed"):
        validate(BridgeParameters, {"protection.alarm_share": 0.6})


@pytest.mark.parametrize(
    ("start", "wanted", "reason"),
    [
        ({}, {"proportional_gain": 0.0}, r"'proportional_gain' = 0 is not allowed on a rig; allowed: as at the start"),
        ({}, {"proportional_gains": (2e4, 1e4)}, r"'proportional_gain' = 20000, 10000 is not allowed"),
        ({"proportional_gains": (2.1e4, 2.2e4)}, {"proportional_gains": ()}, r"'proportional_gain' = 20000"),
        ({}, {"derivative_gain": 50.0}, r"'derivative_gain' = 50 is not allowed on a rig; allowed: 30 to 45"),
        ({}, {"nominal_reference": (1e-4, 0.0)}, r"'nominal_reference' = 0.0001, 0 is"),
    ],
)
def test_a_running_rig_takes_only_what_its_operator_allowed_at_the_start(
    start: dict[str, object], wanted: dict[str, object], reason: str
) -> None:
    allowed, before = AllowedChanges(derivative_gain=(30.0, 45.0)), ControllerParameters(**start)
    with pytest.raises(ParameterError, match=reason):
        allowed.require(before.model_copy(update=wanted), before)
    allowed.require(before, before)
    allowed.require(before.model_copy(update={"derivative_gain": 30.0}), before)


def test_a_range_of_allowed_changes_has_two_ends() -> None:
    with pytest.raises(ParameterError, match=r"derivative_gain = \[45\.0, 30\.0\]; allowed: lowest and highest value"):
        validate(BridgeParameters, {"allowed.derivative_gain": [45.0, 30.0]})


def test_protection_is_only_tightened() -> None:
    start = ProtectionParameters()
    with pytest.raises(ParameterError, match=r"trip_share' = 0\.6 protects less; allowed: up to 0\.5, as now"):
        ProtectionParameters(trip_share=0.6).require_no_looser(start, "now")
    limited = ProtectionParameters(excitation_amplitude=1e-5)
    with pytest.raises(ParameterError, match=r"excitation_amplitude' = 0 protects less"):
        start.require_no_looser(limited, "now")  # 0 is the target's limit
    limited.require_no_looser(start, "now")
