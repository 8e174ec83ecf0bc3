"""The safety case says what the code and its tests say: rows with tests that are there, figures, and the picture."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from docs.generators.safety import IMAGE, command_table, hazard_table, number_of, state_machine, step_table
from tests.safety_case.hazards import BARRIERS, Barrier

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("barrier", BARRIERS, ids=lambda one: re.sub(r"\W+", "-", one.cause))
def test_every_barrier_has_tests_that_are_there(barrier: Barrier) -> None:
    assert barrier.tests
    for test in barrier.tests:
        file, name = test.split("::")
        functions = {
            item.name for item in ast.parse((ROOT / file).read_text()).body if isinstance(item, ast.FunctionDef)
        }
        assert name in functions, f"{file} has no {name}"


@pytest.mark.parametrize("barrier", BARRIERS, ids=lambda one: re.sub(r"\W+", "-", one.cause))
def test_every_barrier_has_a_number(barrier: Barrier) -> None:
    assert re.search(r"\d", number_of(barrier.number))


def test_every_trip_that_switches_off_has_its_rows_in_the_table_of_steps() -> None:
    rows = step_table()
    for reason in (
        "DISPLACEMENT",
        "SENSOR_RANGE",
        "SENSOR_STUCK",
        "OVER_CURRENT",
        "TEMPERATURE",
        "AMPLIFIER",
        "WATCHDOG",
    ):
        assert re.search(rf"\| LEVITATED \| TRIPPED \|.*{reason}", rows)


def test_the_table_of_commands_has_what_the_protocol_demands() -> None:
    rows = {
        row.split("|")[1].strip(): [cell.strip() for cell in row.split("|")[2:-1]]
        for row in command_table().splitlines()
    }
    assert rows["DELEVITATE 0"] == ["stays", "OFF", "OFF", "OFF", "stays"]
    assert rows["FAULT_RESET"][-1] == "OFF; LOCKED"


def test_the_picture_is_that_of_the_search() -> None:
    assert IMAGE.read_text() == state_machine(), "out of date; run: python -m docs.generators.safety"


def test_the_table_of_hazards_has_a_row_for_each_barrier() -> None:
    assert len(hazard_table().splitlines()) == len(BARRIERS) + 2
