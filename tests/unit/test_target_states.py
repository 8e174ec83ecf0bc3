"""Every state that the target can reach with a small configuration: nothing forbidden, and what is planted is found."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from amb_core.rig.link import TargetState
from amb_core.rig.link.reference import SOURCE
from tests.safety_case.states import build, recorded, recorded_of, search, search_all, searched, total

PLANTED = {
    "a trip that does not switch off": (
        "protect.c", "else t->state = AMB_TRIPPED, t->excitation = AMB_NONE;", "else t->excitation = AMB_NONE;",
        "faults"),
    "a reset that keeps the measurement": ("command.c", "    t->measured = false;\n", "", "faults"),
    "levitation with a latched trip": (
        "command.c", "if (t->state != AMB_OFF || !t->measured)", "if (amb_levitating(t))", "faults"),
    "no lock": ("command.c", "if (t->lock_left) return AMB_LOCKED;", "", "faults"),
    "NaN is no position out of range": (
        "protect.c", "if (!(fabs(position) <= t->limits[AMB_SENSOR_LIMIT]))",
        "if (fabs(position) > t->limits[AMB_SENSOR_LIMIT])", "host"),
    "off by a landing": (
        "command.c", "if (amb_levitating(t)) t->state = AMB_OFF;", "amb_ramp(t, AMB_LANDING, 1.0);", "faults"),
    "the watchdog waits for one miss more": (
        "protect.c", "t->debt >= limit", "t->debt > limit", "faults"),
    "an enable that stays": (
        "target.c", "    board_enable(t->board, amb_levitating(t));\n",
        "    if (amb_levitating(t)) board_enable(t->board, true);\n", "faults"),
    "limits that can be raised": (
        "command.c", "value[i] > 0.0 && value[i] <= t->config->limits[i]", "value[i] > 0.0", "gains"),
    "a forged frame spends a counter": (
        "command.c", "        t->count[judgement]++;\n",
        "        t->count[judgement]++;\n        if (judgement == AMB_FORGED) t->counter++;\n", "references"),
    "a description with a new boot": (
        "command.c", "        describe(t, from);\n", "        t->session++;\n        describe(t, from);\n",
        "references"),
    "a current that is no number": (
        "target.c", "if (!(fabs(t->current[a]) <= t->limits[AMB_CURRENT_LIMIT])) amb_trip",
        "if (fabs(t->current[a]) > t->limits[AMB_CURRENT_LIMIT]) amb_trip", "host"),
    "a repeated command is executed": (
        "command.c", "number <= last || far ? AMB_REPLAYED", "number < last || far ? AMB_REPLAYED", "matrices"),
}  # fmt: skip
"""File of the target, what stands there, what is planted instead, and the part that must find it."""


def test_no_reachable_state_breaks_a_rule() -> None:
    assert [part["wrong"] for part in recorded()] == [0] * len(recorded())


def test_the_search_ended_in_every_part() -> None:
    assert all(part["ended"] and min(part["by_state"]) > 0 for part in recorded())


def test_the_host_levitates_the_rotor_again_from_every_state() -> None:
    assert total("recovered") == total("states") > 100_000


def test_it_was_found_with_this_target_and_this_search() -> None:
    assert recorded_of() == searched(), "run: python -m tests.safety_case.states"


@pytest.mark.slow
@pytest.mark.timeout(1200)  # a minute of processor time; a loaded machine needs many
def test_the_search_finds_it_again() -> None:
    assert search_all() == recorded()


def test_only_levitate_powers_and_only_a_reset_leaves_a_trip() -> None:
    powered = {TargetState.LEVITATING, TargetState.LEVITATED, TargetState.LANDING}
    commanded = [tuple(row) for part in recorded() for row in part["commands"]]
    stepped = [tuple(row) for part in recorded() for row in part["steps"]]
    assert {name.split()[0] for was, name, _, to in commanded if was not in powered and to in powered} == {"LEVITATE"}
    assert not [row for row in stepped if row[0] not in powered and row[2] in powered]
    left = {name for was, name, _, to in commanded if was == TargetState.TRIPPED and to != TargetState.TRIPPED}
    assert left == {"FAULT_RESET"}
    assert {to for was, _, to in stepped if was == TargetState.TRIPPED} == {TargetState.TRIPPED}


@pytest.mark.parametrize("name", PLANTED)
def test_what_is_planted_is_found(tmp_path: Path, name: str) -> None:
    file, was, planted, part = PLANTED[name]
    source = tmp_path / "target"
    shutil.copytree(SOURCE, source)
    text = (source / file).read_text()
    assert text.count(was) == 1
    (source / file).write_text(text.replace(was, planted))
    assert search(build(tmp_path, source), part, most=1_500)["wrong"] > 0
