"""Limits and trips of the C target: each with its reason and step, latched until a reset."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from amb_core.rig.link import (
    Code,
    ExcitationPhase,
    Limits,
    TargetState,
    TelemetryBlock,
    TripReason,
    build_library,
    commands,
    excitation_upload,
)
from amb_core.rig.link.reference import SOURCE
from tests.target_rig import Rig

NO_SETTLING = Limits(settle_time=1e-4, stuck_time=5e-4, coil_time=3e-4, lock_time=2e-3)


def levitated(coils: int = 0) -> Rig:
    rig = Rig(2, NO_SETTLING, coils)
    rig.levitate()
    rig.noise(5)
    return rig


def trips(rig: Rig) -> list[tuple[TripReason, int, int]]:
    return [(trip.reason, trip.step, trip.axis) for trip in rig.status().trips]


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ((0.0, 130e-6), (TripReason.DISPLACEMENT, 0)),
        ((90e-6, -90e-6), (TripReason.DISPLACEMENT, 0)),  # radially
        ((np.nan, 0.0), (TripReason.SENSOR_RANGE, 0)),
        ((0.0, -np.inf), (TripReason.SENSOR_RANGE, 1)),
    ],
)
def test_a_position_trips_at_its_step_and_switches_off_in_it(position, expected) -> None:
    rig = levitated()
    step = rig.status().step
    rig.step(position)
    assert (rig.target.enabled, rig.target.current.tolist()) == (False, [0.0, 0.0])
    reason, axis = expected
    assert trips(rig)[0] == (reason, step, axis)
    assert rig.status().state == TargetState.TRIPPED


def test_displacement_beyond_the_alarm_is_reported_and_trips_nothing() -> None:
    rig = levitated()
    rig.step((110e-6, 0.0))
    assert (rig.status().alarm, rig.status().trips) == (True, ())
    rig.step((10e-6, 0.0))
    assert not rig.status().alarm


def test_the_rotor_may_lie_in_its_backup_bearing_before_levitation() -> None:
    rig = Rig(2)
    rig.step((0.0, -250e-6))
    assert rig.command(commands.levitate(0.01)).code == Code.DONE
    rig.step((0.0, -250e-6))
    assert rig.target.enabled


def test_a_sensor_that_does_not_move_trips_after_its_time() -> None:
    rig = levitated()
    rig.step((1e-6, 2e-6))
    step = rig.status().step
    for _ in range(5):
        rig.step((1e-6, 3e-6 + 1e-9 * np.random.default_rng(_).random()))
    assert trips(rig) == [(TripReason.SENSOR_STUCK, step + 4, 0)]


def test_over_current_trips_only_if_it_lasts() -> None:
    rig = levitated(coils=4)
    for number, coil in enumerate((13.0, 13.0, 2.5, 13.0, -13.0, 13.0)):
        assert rig.target.enabled
        step = rig.status().step
        rig.target.coil_current[3] = coil
        rig.step((1e-6 * number, 0.5e-6 * number))
    assert trips(rig) == [(TripReason.OVER_CURRENT, step, 3)]


@pytest.mark.parametrize(
    ("inputs", "reason"),
    [
        ({"temperature": 121.0}, TripReason.TEMPERATURE),
        ({"temperature": np.nan}, TripReason.TEMPERATURE),
        ({"amplifier_fault": True}, TripReason.AMPLIFIER),
        ({"time": 10**9}, TripReason.WATCHDOG),
    ],
)
def test_other_inputs_trip(inputs, reason) -> None:
    rig = levitated()
    step = rig.status().step
    rig.target.position[:] = (3e-6, 4e-6)
    rig.target.step(**inputs)
    assert (rig.target.enabled, trips(rig)) == (False, [(reason, step, 0)])


def test_missed_steps_are_counted_to_the_step() -> None:
    rig = levitated()
    now = 10**7
    for late in (0, 1, 0, 3, 0):
        rig.target.position += 1e-9
        now += 100_000 * (1 + late)
        rig.target.step(now)
    missed = rig.status().missed
    rig.target.step(now + 100_000 * 6)
    assert rig.status().missed - missed == 5


def test_a_trip_stays_until_a_reset_and_refuses_levitation() -> None:
    rig = levitated()
    rig.step((200e-6, 0.0))
    rig.step((1e-3 + 1e-6, 0.0))
    assert [reason for reason, *_ in trips(rig)] == [TripReason.DISPLACEMENT, TripReason.SENSOR_RANGE]
    rig.noise(20)
    assert rig.command(commands.levitate()).code == Code.LATCHED
    assert rig.command(commands.fault_reset()).status.state == TargetState.OFF
    assert rig.status().trips == ()
    rig.noise(1)
    assert rig.command(commands.levitate()).code == Code.DONE


def test_a_cause_that_persists_trips_again_after_a_reset() -> None:
    rig = levitated()
    rig.step((np.nan, 0.0))
    rig.command(commands.fault_reset())
    rig.step((np.nan, 0.0))
    assert rig.command(commands.levitate()).code == Code.LATCHED


def test_what_the_latest_measurement_shows_is_not_levitated_from_after_a_reset() -> None:
    rig = levitated()
    rig.step((0.0, np.inf))
    assert rig.command(commands.fault_reset()).status.state == TargetState.OFF
    assert rig.command(commands.levitate()).code == Code.WRONG_STATE
    rig.step((0.0, np.inf))
    assert rig.command(commands.levitate()).code == Code.LATCHED


def test_telemetry_goes_on_after_a_trip() -> None:
    rig = levitated()
    rig.command(commands.stream(2, 5))
    for position in ((1e-6, 0.0), (np.nan, 1e-6), (2e-6, 0.0), (3e-6, 0.0)):
        rig.step(position)
    blocks = [answer for answer in rig.answers() if isinstance(answer, TelemetryBlock)]
    assert [int(word) & 7 for block in blocks for word in block.status] == [2, 4, 4, 4]
    assert np.isnan(blocks[0].position[1, 0])


def test_a_silent_host_ends_the_excitation_and_not_the_loop() -> None:
    rig = Rig(2, Limits(settle_time=1e-4))
    rig.levitate()
    assert rig.upload(excitation_upload(1, np.full((5000, 2), 20e-6))).code == Code.DONE
    rig.command(commands.stream(1, 1))
    step = rig.status().step
    assert rig.command(commands.arm(1, step + 1)).code == Code.DONE
    rig.noise(400, alive=False)
    reference = np.concatenate(
        [answer.reference for answer in rig.answers() if isinstance(answer, TelemetryBlock)]
    )  # the latest 64
    status = rig.status()
    assert [(trip.reason, trip.step, trip.value) for trip in status.trips] == [
        (TripReason.HOST_SILENT, step + 200, 200.0)
    ]
    assert (status.state, status.excitation, rig.target.enabled) == (TargetState.LEVITATED, ExcitationPhase.NONE, True)
    assert rig.command(commands.arm(1, status.step + 10)).code == Code.LATCHED
    assert len(reference) == 64


def test_an_excitation_that_ends_early_never_jumps() -> None:
    rig = Rig(2, Limits(settle_time=1e-4, excitation_slew=1.0))
    rig.levitate()
    ramp = np.minimum(np.arange(1, 2001), np.arange(2000, 0, -1))[:, None] * [20e-9, -10e-9]
    assert rig.upload(excitation_upload(1, ramp)).code == Code.DONE
    rig.command(commands.stream(1, 1))
    rig.command(commands.arm(1, rig.status().step))
    values = []
    for number in range(1200):
        rig.step((1e-9 * (number % 7), 1e-9 * (number % 5)))
        if number == 1000:
            rig.command(commands.disarm())
        elif number % 100 == 0:
            rig.command(commands.heartbeat())
        values += [answer.reference[0, 0] for answer in rig.answers() if isinstance(answer, TelemetryBlock)]
    changes = np.abs(np.diff([0.0, *values]))
    assert max(values) > 19e-6
    assert values[-1] == 0.0
    assert changes.max() <= 1.01 * 20e-6 / 100  # fades within 10 ms, no faster


def test_a_machine_lands_if_its_host_is_gone_for_the_configured_time() -> None:
    rig = Rig(2, Limits(settle_time=1e-3, land_time=0.02))
    rig.levitate()
    rig.noise(180, alive=False)
    assert rig.target.enabled
    rig.noise(40, alive=False)
    assert not rig.target.enabled
    status = rig.status()
    assert (status.state, status.trips[0].reason) == (TargetState.OFF, TripReason.HOST_SILENT)


# -- limits of time that are infinite


@pytest.fixture
def early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A target that takes 500 steps for all time, so that a count gets there."""
    source = tmp_path / "target"
    shutil.copytree(SOURCE, source)
    parts = source / "parts.h"
    whole = parts.read_text()
    assert whole.count("4000000000u") == 1
    parts.write_text(whole.replace("4000000000u", "500u"))
    library = build_library(tmp_path / "early.so", source=source)
    monkeypatch.setattr("tests.target_rig.library", lambda: library)


@pytest.mark.usefixtures("early")
@pytest.mark.parametrize(
    ("limits", "nominal", "position", "noise", "coil"),
    [
        (Limits(stuck_time=math.inf), 0.0, 1e-6, 0.0, 0.0),
        (Limits(saturation_time=math.inf, control_current=1.0), 0.0, -60e-6, 1e-9, 0.0),
        (Limits(lift_time=math.inf), 70e-6, -60e-6, 1e-9, 0.0),
        (Limits(coil_time=math.inf), 0.0, 1e-6, 1e-9, 13.0),
    ],
    ids=["stuck", "saturated", "far from its reference", "over-current"],
)
def test_what_may_last_for_ever_never_trips(
    limits: Limits, nominal: float, position: float, noise: float, coil: float
) -> None:
    rig = Rig(2, limits, coils=4)
    rig.command(commands.nominal_reference((0.0, nominal)))
    rig.target.coil_current[0] = coil
    rig.step((0.0, position))
    assert rig.command(commands.levitate()).code == Code.DONE
    for number in range(1_200):
        rig.step((noise * (number % 3), position + noise * (number % 3)))
    assert (rig.target.enabled, trips(rig)) == (True, [])


@pytest.mark.usefixtures("early")
def test_a_host_may_be_silent_for_ever_where_its_time_is_infinite() -> None:
    rig = Rig(2, Limits(settle_time=1e-4, host_time=math.inf))
    rig.levitate()
    assert rig.upload(excitation_upload(1, np.zeros((10, 2)))).code == Code.DONE
    assert rig.command(commands.arm(1, 10**6)).code == Code.DONE
    rig.noise(1_200, alive=False)
    assert trips(rig) == []
