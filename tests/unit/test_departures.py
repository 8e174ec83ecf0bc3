"""Which nodes died while a bag was recorded."""

from __future__ import annotations

import threading

from amb_ident_node.departures import PATIENCE, Departures

SIMULATOR = {"/amb/simulator": {"simulator/state", "clock"}}


def periods(departures: Departures, number: int) -> None:
    for _ in range(number):
        departures.note_period(SIMULATOR, "20:00", True)


def test_a_node_that_reports_no_longer_has_died_though_the_graph_still_shows_it() -> None:
    departures = Departures()
    periods(departures, 1)
    departures.note_report("/amb/simulator", "1", "19:59", True)
    periods(departures, PATIENCE - 1)
    assert departures.died() == []
    periods(departures, 1)
    assert departures.died() == [
        "/amb/simulator died or hangs, last seen at 19:59; it published clock, simulator/state"
    ]
    departures.note_report("/amb/simulator", "1", "20:01", True)
    assert departures.died() == []


def test_a_node_of_others_lives_as_long_as_it_publishes() -> None:
    departures = Departures()
    periods(departures, 3 * PATIENCE)
    assert departures.died() == []
    for _ in range(PATIENCE):
        departures.note_period({}, "20:01", True)
    assert departures.died()[0].startswith("/amb/simulator died or hangs, last seen at 20:00")


def test_a_node_that_was_replaced_within_a_run_ended() -> None:
    departures = Departures()
    periods(departures, 1)
    departures.note_report("/amb/simulator", "1", "19:59", True)
    departures.note_report("/amb/simulator", "2", "20:00", True)
    assert departures.died() == [
        "/amb/simulator ended within a run, last seen at 19:59; it published clock, simulator/state"
    ]
    departures.start()
    departures.note_report("/amb/simulator", "3", "20:00", False)
    assert departures.died() == []


def test_a_node_that_has_left_the_graph_between_two_runs_did_not_die_in_the_second() -> None:
    """Such as a controller that another one replaces while the simulator is paused."""
    departures = Departures()
    periods(departures, 1)
    departures.note_report("/amb/simulator", "1", "19:59", True)
    for _ in range(PATIENCE):
        departures.note_period({}, "20:01", False)
    for _ in range(PATIENCE):
        departures.note_period({}, "20:02", True)
    assert departures.died() == []


def test_a_node_that_is_silent_between_two_runs_and_still_in_the_graph_is_missed_in_the_second() -> None:
    departures = Departures()
    periods(departures, 1)
    departures.note_report("/amb/simulator", "1", "19:59", True)
    for _ in range(PATIENCE):
        departures.note_period(SIMULATOR, "20:01", False)
    assert departures.died(within_run=False) == []
    assert departures.died() != []


def test_waiting_ends_with_a_sign_of_life_or_with_patience() -> None:
    departures = Departures()
    periods(departures, 1)
    departures.note_report("/amb/simulator", "1", "19:59", True)
    for end in (lambda: departures.note_report("/amb/simulator", "1", "20:00", True), lambda: periods(departures, 9)):
        waiting = threading.Thread(target=departures.wait_for_signs)
        waiting.start()
        while waiting.is_alive():
            end()
            waiting.join(0.01)
    departures.end()
    departures.wait_for_signs()
