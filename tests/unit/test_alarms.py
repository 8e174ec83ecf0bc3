"""An alarm ends when its cause does, and the node still shows when it was."""

from __future__ import annotations

from amb_ros.alarms import HOLD, AlarmRecord, RecentProblem


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


def test_an_error_that_becomes_a_warning_is_over() -> None:
    alarms = AlarmRecord()
    for level, text, now in ((2, "two controllers", "1"), (1, "drift", "2"), (0, "ok", "3")):
        alarms.note(level, text, now)
    assert alarms.last == "drift (from 2 to 3)"
