"""An alarm ends when its cause does, and the node still shows when it was."""

from __future__ import annotations

from amb_ros.alarms import HOLD, KEPT, AlarmRecord, RecentProblem


def test_an_event_is_a_problem_for_a_while() -> None:
    now = 100.0
    problem = RecentProblem(lambda: now)
    assert problem.text == ""
    assert problem.note("a block was refused")
    now += 0.9 * HOLD
    assert not problem.note("another block was refused")
    now += 0.9 * HOLD
    assert problem.text == "another block was refused"
    now += HOLD
    assert (problem.text, problem.last) == ("", "another block was refused")


def test_an_alarm_that_is_over_is_shown_with_its_times() -> None:
    alarms = AlarmRecord()
    for level, text, now in ((0, "ok", "1"), (2, "no answer to step 5", "2"), (2, "no answer to step 6", "3")):
        alarms.note(level, text, now)
        assert alarms.last == ""
    alarms.note(0, "ok", "4")
    assert alarms.last == "no answer to step 6 (from 2 to 4)"
    alarms.note(0, "ok", "5")
    assert alarms.last == "no answer to step 6 (from 2 to 4)"


def recorded(*reports: tuple[int, str]) -> str:
    """The last alarm after these reports, at times 1, 2, 3."""
    alarms = AlarmRecord()
    for now, (level, text) in enumerate(reports, 1):
        alarms.note(level, text, str(now))
    return alarms.last


def test_an_error_that_becomes_a_warning_is_over_and_stays_the_last_alarm() -> None:
    assert recorded((2, "two controllers"), (1, "drift")) == "two controllers (from 1 to 2)"
    assert recorded((2, "two controllers"), (1, "drift"), (0, "ok")) == "two controllers (from 1 to 2)"
    assert recorded((1, "drift"), (2, "two controllers"), (1, "drift"), (0, "ok")) == "two controllers (from 2 to 3)"


def test_an_alarm_that_becomes_another_one_of_its_level_has_times_of_its_own() -> None:
    both = "two controllers (from 1 to 4); no answer (from 4 to 5)"
    assert recorded(*[(2, "two controllers")] * 3, (2, "no answer"), (0, "ok")) == both


def test_an_alarm_after_all_was_well_takes_the_place_of_those_before_it() -> None:
    assert recorded((2, "two controllers"), (0, "ok"), (1, "drift")) == "two controllers (from 1 to 2)"
    assert recorded((2, "two controllers"), (0, "ok"), (1, "drift"), (0, "ok")) == "drift (from 3 to 4)"


def test_of_alarms_that_alternate_the_latest_are_kept() -> None:
    alternating = recorded(*[(2, "two controllers"), (2, "no answer")] * 50, (0, "ok"))
    assert alternating.endswith("no answer (from 100 to 101)")
    assert alternating.count("; ") == KEPT - 1
