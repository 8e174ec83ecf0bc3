"""The C target with the loop closed by the host: its currents flow at once, hold, and are missed."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.rig.link import Code, Law, Limits, Session, TargetState, TripReason, commands, excitation_upload
from tests.target_rig import HOST, NONCE, Rig

MISSED = 5
PERIOD = 100_000  # ns
LIMITS = Limits(missed_steps=MISSED, settle_time=0.002, excitation_amplitude=1.0, alarm_share=1e9, trip_share=1e9)
PLACE = (3e-6, -2e-6)


def levitated(law: Law = Law.HOST, limits: Limits = LIMITS) -> Rig:
    rig = Rig(2, limits)
    rig.step(PLACE)
    assert rig.command(commands.controller(law)).code == Code.DONE
    assert rig.command(commands.levitate()).code == Code.DONE
    rig.step(PLACE)
    return rig


def answer(rig: Rig, current: tuple[float, float], behind: int = 0) -> None:
    """The current of the host for the latest step, or for one before it."""
    rig.target.feed(commands.current(rig.session, rig.target.steps - 1 - behind, current), HOST)
    assert rig.target.take() == []  # no reply


class Late:
    """A target that misses control steps: its clock is as many samples ahead of its steps."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.missed = rig, 0

    def step(self, missed: int = 0) -> None:
        """A control step, and so many that are missed before it."""
        self.missed += missed
        self.rig.target.position[:] = PLACE
        self.rig.target.step((self.rig.target.steps + self.missed) * PERIOD)


def test_a_current_flows_as_soon_as_it_arrives() -> None:
    rig = levitated()
    assert (rig.target.enabled, rig.target.current.tolist(), rig.target.waits) == (True, [0.0, 0.0], True)
    answer(rig, (0.5, -0.25))
    assert (rig.target.current.tolist(), rig.target.waits) == ([0.5, -0.25], False)


def test_the_limit_of_the_current_holds_for_those_of_the_host_too() -> None:
    rig = levitated()
    answer(rig, (1e9, -np.inf))
    assert rig.target.current.tolist() == [3.0, -3.0]
    rig.step(PLACE)
    answer(rig, (np.nan, 0.0))
    assert (rig.target.enabled, rig.target.current.tolist()) == (False, [0.0, 0.0])
    assert [trip.reason for trip in rig.status().trips] == [TripReason.LAW]


def test_a_missing_current_holds_the_last_one_and_counts() -> None:
    rig = levitated()
    answer(rig, (0.5, -0.25))
    for _ in range(MISSED):  # the last of these steps is the first but one that is missed too often
        rig.step(PLACE)
        assert rig.target.current.tolist() == [0.5, -0.25]
    answer(rig, (0.75, 0.0))
    rig.step(PLACE)
    assert (rig.status().missed, rig.status().state) == (MISSED - 1, TargetState.LEVITATED)
    assert rig.target.current.tolist() == [0.75, 0.0]


def test_without_currents_for_too_long_it_switches_off() -> None:
    rig = levitated(Law.HOST)
    answer(rig, (0.5, -0.25))
    for _ in range(MISSED + 1):
        assert rig.target.enabled
        rig.step(PLACE)
    assert not rig.target.enabled
    (trip,) = rig.status().trips
    assert (trip.reason, trip.value) == (TripReason.WATCHDOG, MISSED)
    assert rig.status().state == TargetState.TRIPPED


def test_or_the_pd_law_lands_it_with_the_current_that_a_pd_of_the_host_would_have_sent() -> None:
    law = PdController(ControllerParameters())
    rig = levitated(Law.HOST_OR_LAND)
    rng = np.random.default_rng(1)
    place = np.array(PLACE)
    for _ in range(20):
        answer(rig, tuple(law.update(place, (0.0, 0.0))))
        place = rng.normal(0.0, 2e-6, 2)
        rig.step(place)
    for _ in range(MISSED):
        law.update(place, (0.0, 0.0))  # the host is silent, and knows what it would have sent
        place = rng.normal(0.0, 2e-6, 2)
        rig.step(place)
    status = rig.status()
    assert (status.state, [trip.reason for trip in status.trips]) == (TargetState.LANDING, [TripReason.HOST_SILENT])
    np.testing.assert_array_equal(rig.target.current, law.update(place, (0.0, 0.0)))
    rig.noise(round(LIMITS.settle_time * 10_000.0) + 2)
    assert (rig.status().state, rig.target.enabled) == (TargetState.OFF, False)


@pytest.mark.parametrize("answered", [False, True])
def test_it_lands_too_where_the_step_that_is_one_too_many_comes_late(answered: bool) -> None:
    rig = levitated(Law.HOST_OR_LAND)
    answer(rig, (0.5, -0.25))
    for _ in range(MISSED):
        rig.step(PLACE)
    assert rig.status().state == TargetState.LEVITATED
    if answered:
        answer(rig, (0.5, -0.25))
    Late(rig).step(2)
    (trip,) = rig.status().trips
    assert (rig.status().state, trip.reason) == (TargetState.LANDING, TripReason.HOST_SILENT)


def test_a_target_that_misses_too_many_steps_itself_does_not_land() -> None:
    rig = levitated(Law.HOST_OR_LAND)
    answer(rig, (0.5, -0.25))
    for _ in range(MISSED):
        rig.step(PLACE)
    Late(rig).step(MISSED)
    assert [trip.reason for trip in rig.status().trips] == [TripReason.WATCHDOG]
    assert not rig.target.enabled


def test_on_the_landing_only_those_steps_count_that_the_target_has_missed() -> None:
    rig = levitated(Law.HOST_OR_LAND)
    late = Late(rig)
    late.step(2)
    for _ in range(MISSED - 2):
        late.step()
    assert rig.status().state == TargetState.LANDING
    late.step(MISSED - 3)
    assert (rig.status().state, rig.target.enabled) == (TargetState.LANDING, True)
    late.step(2)
    assert rig.status().state == TargetState.TRIPPED
    assert [trip.reason for trip in rig.status().trips] == [TripReason.HOST_SILENT, TripReason.WATCHDOG]


def test_the_host_can_land_with_the_pd_law() -> None:
    rig = levitated()
    answer(rig, (0.5, -0.25))
    assert rig.command(commands.delevitate(0.001)).code == Code.DONE
    rig.noise(9)
    assert rig.target.enabled
    rig.noise(3)
    assert (rig.target.enabled, rig.status().trips) == (False, ())


@pytest.mark.parametrize("behind", [0, 1, -1, -1000], ids=["again", "of before", "to come", "far ahead"])
def test_a_current_is_taken_once_and_only_for_a_step_that_was_measured(behind: int) -> None:
    rig = levitated()
    rig.step(PLACE)
    answer(rig, (0.5, -0.25))
    answer(rig, (1.0, 1.0), behind)
    assert rig.target.current.tolist() == [0.5, -0.25]
    assert rig.status().replayed == (behind >= 0)


def test_a_current_of_the_step_before_is_better_than_none() -> None:
    rig = levitated()
    rig.step(PLACE)
    answer(rig, (1.0, 1.0), behind=1)
    answer(rig, (0.5, -0.25))
    assert rig.target.current.tolist() == [0.5, -0.25]


def test_currents_of_others_and_of_other_boots_are_not_taken() -> None:
    rig = levitated()
    step = rig.target.steps - 1
    wrong = Session(NONCE, 2, 0, bytes(32)), Session(NONCE[:4] + bytes(12), 2, 0, rig.key)
    for session in wrong:
        rig.target.feed(commands.current(session, step, (1.0, 1.0)), HOST)
    rig.target.feed(commands.current(rig.session, step, (1.0,)), HOST)  # of one axis
    assert rig.target.current.tolist() == [0.0, 0.0]
    assert rig.status().forged == 2


def test_a_current_does_not_come_between_a_command_and_its_repetition() -> None:
    rig = levitated()
    frame = rig.writer.write(commands.heartbeat())
    (reply,) = rig.send(frame)
    answer(rig, (0.5, -0.25))
    (again,) = rig.send(frame)
    assert (again.counter, again.code) == (reply.counter, Code.DONE)


def test_without_the_choice_of_it_currents_of_the_host_do_nothing() -> None:
    rig = Rig(2, LIMITS)
    rig.levitate()
    before = rig.target.current.tolist()
    answer(rig, (0.5, -0.25))
    assert rig.target.current.tolist() == before
    assert not rig.status().by_host


def test_the_loop_does_not_change_hands_while_it_is_closed() -> None:
    rig = levitated()
    assert rig.status().by_host
    assert rig.command(commands.controller(Law.PD)).code == Code.WRONG_STATE
    other = Rig(2, LIMITS)
    other.levitate()
    assert other.command(commands.controller(Law.HOST)).code == Code.WRONG_STATE


def test_the_target_plays_no_excitation_since_the_host_has_the_reference() -> None:
    rig = levitated()
    assert rig.upload(excitation_upload(1, np.full((10, 2), 1e-6))).code == Code.DONE
    assert rig.command(commands.arm(1, rig.target.steps + 50)).code == Code.WRONG_STATE
