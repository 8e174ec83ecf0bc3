"""What the C target does to a rotor, whatever it is commanded: no jump, no way out of its clearance, off at once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters
from amb_core.rig.link import (
    Code,
    ExcitationPhase,
    Law,
    Limits,
    TargetState,
    TelemetryBlock,
    TripReason,
    commands,
    excitation_upload,
)
from tests.target_rig import HOST, Rig

RATE = 10_000.0
SLEW = 0.01  # m/s
SETTLED = Limits(settle_time=1e-3, excitation_slew=1.0)


def levitated(limits: Limits = SETTLED, coils: int = 0) -> Rig:
    rig = Rig(2, limits, coils)
    rig.levitate()
    rig.noise(15)
    return rig


def references(rig: Rig, steps: int) -> np.ndarray:
    """The references of so many steps, with a rotor near the centre and a host that shows itself."""
    rows = []
    rng = np.random.default_rng(steps)
    for number in range(steps):
        rig.step(rng.normal(0.0, 1e-7, 2))
        rows += [item.reference for item in rig.answers() if isinstance(item, TelemetryBlock)]
        if number % 50 == 0:
            rig.command(commands.heartbeat())
    return np.concatenate(rows)


def reasons(rig: Rig) -> list[TripReason]:
    return [trip.reason for trip in rig.status().trips]


def code(rig: Rig, command: object) -> Code:
    return rig.command(command).code  # type: ignore[arg-type]


# -- changes while levitated


def test_a_new_nominal_reference_is_reached_no_faster_than_its_slew() -> None:
    rig = levitated()
    rig.command(commands.stream(1, 1))
    assert code(rig, commands.nominal_reference((80e-6, 40e-6))) == Code.DONE
    references_seen = references(rig, 100)
    assert np.abs(np.diff(references_seen, axis=0)).max() <= SLEW / RATE * (1.0 + 1e-9)
    assert references_seen[-1].tolist() == [80e-6, 40e-6]


def test_another_one_on_the_way_begins_where_the_reference_is() -> None:
    rig = levitated()
    rig.command(commands.stream(1, 1))
    rig.command(commands.nominal_reference((80e-6, 0.0)))
    first = references(rig, 30)
    rig.command(commands.nominal_reference((-80e-6, 0.0)))
    signal = np.vstack([first, references(rig, 150)])
    assert np.abs(np.diff(signal, axis=0)).max() <= SLEW / RATE * (1.0 + 1e-9)
    assert signal[-1].tolist() == [-80e-6, 0.0]


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"proportional_gain": 0.0}, Code.BEYOND_LIMIT),
        ({"proportional_gain": 9_999.0}, Code.BEYOND_LIMIT),
        ({"proportional_gain": 40_001.0}, Code.BEYOND_LIMIT),
        ({"derivative_gain": 0.0}, Code.BEYOND_LIMIT),
        ({"derivative_filter": 1e-3}, Code.WRONG_STATE),
        ({"derivative_on": "measurement"}, Code.WRONG_STATE),
        ({"proportional_gain": 10_000.0, "derivative_gain": 76.0}, Code.DONE),
    ],
)
def test_gains_that_would_drop_a_levitated_rotor_are_refused(changed, expected) -> None:
    gains = commands.gains(ControllerParameters(**changed), 2)
    rig = levitated()
    assert code(rig, gains) == expected
    assert code(Rig(2), gains) == Code.DONE


def test_gains_change_little_by_little() -> None:
    rig = levitated(Limits(settle_time=0.01))
    rig.step((10e-6, 0.0))
    rig.command(commands.gains(ControllerParameters(proportional_gain=40_000.0), 2))
    gains = []
    for number in range(120):
        rig.step((10e-6 + 1e-15 * (number % 2), 0.0))
        gains.append(-rig.target.current[0] / 10e-6)
    assert np.abs(np.diff(gains)).max() < 1.1 * 20_000.0 / 100
    assert gains[0] < 20_300.0
    assert gains[-1] == pytest.approx(40_000.0)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"control_current": 0.1}, Code.WRONG_STATE),
        ({"sensor_range": 1e-6}, Code.WRONG_STATE),
        ({"reference_slew": 1e-3}, Code.WRONG_STATE),
        ({"trip_share": 0.01}, Code.BEYOND_LIMIT),
        ({"trip_share": 0.45, "host_time": 0.01}, Code.DONE),
    ],
)
def test_limits_that_would_drop_a_levitated_rotor_are_refused(changed, expected) -> None:
    lowered = commands.limits(Limits(**{**vars(SETTLED), **changed}))
    rig = levitated()
    rig.step((10e-6, 0.0))
    assert code(rig, lowered) == expected
    assert rig.target.enabled
    assert code(Rig(2, SETTLED), lowered) == Code.DONE


# -- the sum of nominal reference and excitation


def test_the_nominal_reference_is_checked_radially() -> None:
    rig = Rig(2)
    assert code(rig, commands.nominal_reference((90e-6, 90e-6))) == Code.BAD_VALUE
    assert code(rig, commands.nominal_reference((70e-6, 70e-6))) == Code.DONE
    assert code(rig, commands.landing_reference((200e-6, 200e-6))) == Code.BAD_VALUE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_reference_that_is_no_number_is_refused_in_every_state(value: float) -> None:
    for rig in (Rig(2), levitated()):
        for write in (commands.nominal_reference, commands.landing_reference):
            assert code(rig, write((0.0, value))) == Code.BAD_VALUE


def armed(rig: Rig, samples: np.ndarray, number: int = 1) -> Code:
    assert rig.upload(excitation_upload(number, samples)).code == Code.DONE
    return code(rig, commands.arm(number, rig.target.steps + 20))


def test_the_sum_of_reference_and_excitation_is_checked_at_arming_and_at_every_change() -> None:
    wave = 80e-6 * np.sin(np.arange(4_000) / 100.0)[:, None] * [1.0, 0.0]
    rig = levitated()
    rig.command(commands.nominal_reference((0.0, 60e-6)))
    assert armed(rig, wave) == Code.BEYOND_LIMIT
    rig.command(commands.nominal_reference((0.0, 40e-6)))
    assert armed(rig, wave, 2) == Code.DONE
    assert code(rig, commands.nominal_reference((0.0, 60e-6))) == Code.BEYOND_LIMIT
    assert code(rig, commands.limits(Limits(**{**vars(SETTLED), "trip_share": 0.45}))) == Code.BEYOND_LIMIT
    assert code(rig, commands.nominal_reference((0.0, 20e-6))) == Code.DONE


def test_axes_that_are_excited_one_after_the_other_do_not_add() -> None:
    rig = levitated()
    wave = np.zeros((601, 2))
    wave[:300, 0] = wave[301:, 1] = 99e-6 * np.sin(np.linspace(0.0, math.pi, 300))
    assert armed(rig, wave) == Code.DONE
    both = np.stack([wave[:, 0], wave[:, 0]], axis=1)
    assert armed(levitated(), both) == Code.BEYOND_LIMIT


def test_an_excitation_that_played_when_the_rotor_was_dropped_is_not_there_at_the_next_lift_off() -> None:
    rig = levitated()
    rig.command(commands.stream(1, 1))
    assert armed(rig, np.full((5_000, 2), 50e-6)) == Code.DONE
    references(rig, 60)
    rig.command(commands.delevitate(0.0))
    assert rig.status().excitation is ExcitationPhase.NONE
    rig.step((1e-7, 0.0))
    rig.command(commands.levitate(0.0))
    assert not references(rig, 200)[1:].any()


def test_a_fade_ends_within_a_minute_however_low_the_slew() -> None:
    rig = levitated()
    assert armed(rig, np.full((5_000, 2), 50e-6)) == Code.DONE
    rig.noise(60)
    assert code(rig, commands.limits(Limits(**{**vars(SETTLED), "excitation_slew": 5e-324}))) == Code.BEYOND_LIMIT
    slow = Limits(**{**vars(SETTLED), "excitation_slew": 1e-3})
    assert code(rig, commands.limits(slow)) == Code.DONE
    rig.command(commands.disarm())
    rig.command(commands.stream(1, 1))
    references_seen = references(rig, 600)
    assert np.abs(np.diff(references_seen, axis=0)).max() <= 1e-3 / RATE * (1.0 + 1e-9)
    assert rig.status().excitation is ExcitationPhase.NONE


def test_a_slew_limit_that_is_lowered_meanwhile_stops_the_excitation_without_a_jump() -> None:
    rig = levitated()
    rig.command(commands.stream(1, 1))
    wave = 50e-6 * np.sin(np.arange(4_000) / 20.0)[:, None] * [1.0, 0.0]
    assert armed(rig, wave) == Code.DONE
    references(rig, 100)
    assert code(rig, commands.limits(Limits(**{**vars(SETTLED), "excitation_slew": 5e-3}))) == Code.DONE
    references_seen = references(rig, 200)
    assert reasons(rig) == [TripReason.EXCITATION]
    assert np.abs(np.diff(references_seen, axis=0)).max() <= 5e-3 / RATE * (1.0 + 1e-9)


# -- protection on the ramps


def test_a_rotor_beyond_its_clearance_is_not_levitated() -> None:
    rig = Rig(2)
    rig.step((900e-6, 900e-6))
    assert rig.status().trips == ()
    assert code(rig, commands.levitate(1.0)) == Code.BEYOND_LIMIT
    assert not rig.target.enabled


@pytest.mark.parametrize("landing", [False, True])
def test_displacement_beyond_the_contact_trips_while_levitating_and_landing(landing: bool) -> None:
    rig = Rig(2)
    rig.step((0.0, -250e-6))
    rig.command(commands.levitate(1.0))
    rig.step((0.0, -251e-6))
    if landing:
        rig.command(commands.delevitate(1.0))
    rig.step((0.0, -299e-6))
    assert rig.target.enabled
    rig.step((0.0, 301e-6))
    assert (rig.target.enabled, reasons(rig)) == (False, [TripReason.DISPLACEMENT])


def test_a_rotor_that_does_not_lift_off_is_given_up_before_the_ramp_ends() -> None:
    rig = Rig(2, Limits(saturation_time=1e9))
    rig.step((0.0, -250e-6))
    rig.command(commands.levitate(1.0))
    rig.step((0.0, -251e-6))
    steps = 0
    while rig.target.enabled and steps < 10_000:
        rig.step((0.0, -250e-6 - 1e-8 * (steps % 3)))
        steps += 1
    assert reasons(rig) == [TripReason.DISPLACEMENT]
    assert steps == pytest.approx(5_000 + 2_000, abs=10)  # half the ramp is beyond the trip share, and the lift time


def test_a_trip_by_the_lift_time_has_the_distance_from_the_reference() -> None:
    rig = Rig(2, Limits(lift_time=0.005))
    rig.command(commands.nominal_reference((0.0, 100e-6)))
    rig.step((0.0, 100e-6))
    rig.command(commands.levitate(0.0))
    for number in range(60):
        rig.step((1e-9 * (number % 3), -40e-6))
    (trip,) = rig.status().trips
    assert (trip.reason, trip.value) == (TripReason.DISPLACEMENT, pytest.approx(140e-6 / 250e-6, abs=1e-4))


def test_a_current_at_its_limit_is_not_kept_there() -> None:
    rig = Rig(2)
    rig.step((0.0, -250e-6))
    rig.command(commands.levitate(0.0))
    rig.step((0.0, -251e-6))
    steps = 0
    while rig.target.enabled and steps < 10_000:
        rig.step((1e-8 * (steps % 3), -250e-6 - 1e-8 * (steps % 3)))
        steps += 1
    assert reasons(rig) == [TripReason.SATURATED]
    assert steps == pytest.approx(500, abs=2)


@pytest.mark.parametrize("landing", [False, True])
def test_a_sensor_that_is_stuck_is_found_on_the_ramps_too(landing: bool) -> None:
    rig = Rig(2)
    rig.step((0.0, -50e-6))
    rig.command(commands.levitate(5.0))
    rig.step((0.0, -50e-6))
    if landing:
        rig.command(commands.delevitate(5.0))
    for number in range(300):
        rig.step((1e-8 * (number % 3), -50e-6))
    assert reasons(rig) == [TripReason.SENSOR_STUCK]


def test_a_rotor_that_lies_on_its_backup_bearing_may_stand_still() -> None:
    rig = Rig(2)
    rig.step((0.0, -250e-6))
    rig.command(commands.levitate(60.0))
    for _ in range(1_000):
        rig.step((0.0, -250e-6))
    assert rig.target.enabled


# -- the watchdog


@pytest.mark.parametrize(
    ("missed", "every", "trips"), [(19, 20, True), (1, 10, True), (1, 40, False), (19, 1_000, False)]
)
def test_the_watchdog_counts_the_rate_of_misses(missed: int, every: int, trips: bool) -> None:
    """`missed` of `every` steps, for ever; at 5 percent and less only what is missed at a time counts."""
    rig = levitated()
    now = round((rig.target.steps - 1) * 1e9 / RATE)
    rng = np.random.default_rng(1)
    for _ in range(200 if trips else 20):
        for number in range(every - missed):
            now += 100_000 * (1 + missed if number == 0 else 1)
            rig.target.position[:] = rng.normal(0.0, 1e-6, 2)
            rig.target.step(now)
        rig.command(commands.heartbeat())
    assert reasons(rig) == ([TripReason.WATCHDOG] if trips else [])


def test_currents_of_the_host_that_are_mostly_missed_trip_too() -> None:
    rig = Rig(2, Limits(missed_steps=20, settle_time=1e-3, alarm_share=1e9, trip_share=1e9))
    rig.step((1e-6, 0.0))
    rig.command(commands.controller(Law.HOST))
    rig.command(commands.levitate())
    rng = np.random.default_rng(1)
    for number in range(400):
        rig.step(rng.normal(0.0, 1e-6, 2))
        if number % 20 == 0:
            rig.target.feed(commands.current(rig.session, rig.target.steps - 1, (0.0, 0.0)), HOST)
    assert reasons(rig) == [TripReason.WATCHDOG]


# -- off, reset and lock-out


def test_off_acts_at_once_in_every_state() -> None:
    for before in ((), (commands.delevitate(60.0),), (commands.delevitate(0.0),), ("trip",)):
        rig = levitated()
        assert rig.target.hardware_enable
        for command in before:
            if command == "trip":
                rig.step((math.nan, 0.0))
            else:
                rig.command(command)
        assert code(rig, commands.delevitate(0.0)) == Code.DONE
        assert (rig.target.enabled, rig.target.hardware_enable) == (False, False)
        assert rig.status().state in (TargetState.OFF, TargetState.TRIPPED)


def test_a_landing_can_be_shortened_and_not_drawn_out() -> None:
    rig = levitated()
    rig.command(commands.delevitate(1.0))
    rig.command(commands.delevitate(0.001))
    rig.command(commands.delevitate(60.0))
    rig.noise(12)
    assert not rig.target.enabled


@pytest.mark.parametrize("seconds", [1e-4, 1e-5])
@pytest.mark.parametrize("every", [1, 2, 7])
def test_a_landing_that_is_commanded_again_and_again_ends_no_later_and_keeps_its_slew(
    seconds: float, every: int
) -> None:
    """At 1 um a step the landing reference is 200 steps away."""
    rig = levitated()
    rig.command(commands.landing_reference((0.0, -200e-6)))
    rig.command(commands.stream(1, 1))
    reference, steps = [0.0], 0
    while rig.target.enabled and steps < 1_000:
        if steps % every == 0:
            rig.command(commands.delevitate(seconds))
        rig.step((1e-9 * (steps % 3), reference[-1] + 1e-9 * (steps % 3)))
        reference += [item.reference[-1, 1] for item in rig.answers() if isinstance(item, TelemetryBlock)]
        steps += 1
    assert (rig.status().state, reasons(rig)) == (TargetState.OFF, [])
    assert steps <= 202  # one to begin, one for a last fraction of the slew
    assert np.abs(np.diff(reference[:-1])).max() <= SLEW / RATE * (1.0 + 1e-9)


def test_a_reference_slew_with_which_no_landing_ends_is_refused() -> None:
    """From one end of the clearance of 250 um to the other in a minute at least."""
    assert code(Rig(2), commands.limits(Limits(reference_slew=9e-6))) == Code.DONE
    assert code(Rig(2), commands.limits(Limits(reference_slew=8e-6))) == Code.BAD_VALUE


def test_a_trip_switches_the_hardware_enable_off_in_its_step() -> None:
    rig = levitated()
    rig.step((math.nan, 0.0))
    assert not rig.target.hardware_enable


def test_after_a_trip_by_displacement_faults_are_not_reset_at_once() -> None:
    rig = levitated(Limits(settle_time=1e-3, lock_time=0.005))
    rig.step((200e-6, 0.0))
    assert (code(rig, commands.fault_reset()), rig.status().locked) == (Code.LOCKED, True)
    assert reasons(rig) == [TripReason.DISPLACEMENT]
    rig.noise(50)
    assert (code(rig, commands.fault_reset()), rig.status().locked) == (Code.DONE, False)
    forever = levitated(Limits(settle_time=1e-3, lock_time=math.inf))
    forever.step((200e-6, 0.0))
    forever.noise(1_000)
    assert code(forever, commands.fault_reset()) == Code.LOCKED
    shorter = Limits(**{**vars(SETTLED), "lock_time": 1e-4})
    assert code(Rig(2, SETTLED), commands.limits(shorter)) == Code.BAD_VALUE


def test_resets_do_not_count_one_measurement_again() -> None:
    rig = Rig(2, Limits(coil_time=1e-3), coils=4)
    rig.target.coil_current[0] = 13.0
    rig.step((1e-6, 0.0))
    for _ in range(20):
        rig.command(commands.fault_reset())
    assert rig.status().trips == ()


def test_a_refused_current_is_no_sign_of_life_and_cannot_be_sent_again() -> None:
    rig = Rig(2, Limits(settle_time=1e-3, land_time=0.02, missed_steps=1e6, alarm_share=1e9, trip_share=1e9))
    rig.step((1e-6, 0.0))
    rig.command(commands.controller(Law.HOST))
    rig.command(commands.levitate())
    ahead = commands.current(rig.session, rig.target.steps + 1, (1.0, 1.0))
    rig.target.feed(ahead, HOST)  # for a step that has not been measured
    rng = np.random.default_rng(1)
    for number in range(195):
        rig.step(rng.normal(0.0, 1e-6, 2))
        rig.target.feed(commands.current(rig.session, rig.target.steps - 1, (0.0,)), HOST)  # of one axis
        if number == 3:
            rig.target.feed(ahead, HOST)
            assert not rig.target.current.any()
    assert rig.target.enabled
    for _ in range(10):
        rig.step(rng.normal(0.0, 1e-6, 2))
    assert reasons(rig) == [TripReason.HOST_SILENT]
