"""Experiments: the steps to identify from, and the telemetry that is kept for them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from amb_core.ground.errors import IdentificationError
from amb_core.loop.experiments import (
    KEPT_EXCITATIONS,
    AppliedExcitation,
    ExperimentBuffer,
    controller_of,
    last_experiment,
    select_window,
)
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import StepCoverage, describe_gaps
from amb_core.recording.messages.excitation_status import answer_from_message


def excitation(first_step: int, steps: int, run: int = 1, number: int = 1, accepted: bool = True) -> AppliedExcitation:
    return AppliedExcitation(run, number, "square" if steps else "stop", accepted, "", first_step, steps)


def block(first_step: int, steps: int = 100) -> LoopRecord:
    samples = np.arange(first_step, first_step + steps, dtype=float)[:, np.newaxis] * [1.0, -1.0]
    return LoopRecord(first_step, 1e-4, samples, samples, samples)


@pytest.mark.parametrize(
    ("excitations", "window"),
    [
        ([], None),
        ([excitation(100, 50)], (100, 150)),
        ([excitation(100, 50), excitation(300, 10)], (300, 310)),
        ([excitation(100, 50), excitation(300, 10, accepted=False)], (100, 150)),
        ([excitation(100, 50), excitation(300, 10, run=2)], (100, 150)),
        ([excitation(100, 50), excitation(120, 0)], (100, 120)),
        ([excitation(100, 50), excitation(900, 0)], (100, 150)),
        ([excitation(100, 50), excitation(20, 0)], (100, 100)),
        ([excitation(20, 0)], None),
    ],
)
def test_the_last_experiment_is_the_last_accepted_excitation_up_to_its_stop(
    excitations: list[AppliedExcitation], window: tuple[int, int] | None
) -> None:
    assert last_experiment(excitations, run=1) == window


@pytest.mark.parametrize(
    ("experiment", "first_step", "steps", "window"),
    [
        (None, -1, 0, (50, 1000)),
        ((100, 400), -1, 0, (100, 400)),
        ((100, 4000), -1, 0, (100, 1000)),
        ((100, 400), -1, 20, (100, 120)),
        ((100, 400), 200, 0, (200, 400)),
        ((100, 400), 600, 0, (600, 1000)),
        ((100, 400), 0, 30, (0, 30)),
    ],
)
def test_the_window_is_the_experiment_unless_asked_otherwise(
    experiment: tuple[int, int] | None, first_step: int, steps: int, window: tuple[int, int]
) -> None:
    assert select_window((50, 1000), experiment, first_step, steps) == window


@pytest.mark.parametrize(("first_step", "steps"), [(-2, 0), (0, -1), (1000, 0)])
def test_a_window_without_samples_is_refused(first_step: int, steps: int) -> None:
    with pytest.raises(IdentificationError, match="step"):
        select_window((50, 1000), None, first_step, steps)


def test_the_control_law_is_found_among_other_parameters() -> None:
    controller = controller_of({"proportional_gain": 3e4, "telemetry_block": 100, "use_sim_time": False}, 20_000.0)
    assert (controller.proportional_gain, controller.sample_rate) == (3e4, 20_000.0)


def test_the_buffer_keeps_the_latest_samples() -> None:
    buffer = ExperimentBuffer(capacity=250)
    for number in range(10):
        buffer.add_block(1, block(100 * number))
    assert buffer.available == (700, 1000)
    np.testing.assert_array_equal(buffer.record(750, 900).position[:, 0], np.arange(750.0, 900.0))
    with pytest.raises(IdentificationError, match="steps 650 to 699 are missing"):
        buffer.record(650, 900)


def test_blocks_without_steps_take_bounded_memory() -> None:
    buffer = ExperimentBuffer(capacity=250)
    for number in range(1_000):
        buffer.add_block(1, block(number, steps=0))
    assert len(buffer._blocks) <= 250


def test_the_buffer_starts_afresh_with_a_run_or_a_restarted_simulator() -> None:
    buffer = ExperimentBuffer(capacity=1000)
    buffer.add_block(1, block(0))
    buffer.add_block(1, block(100))
    buffer.add_block(2, block(0))
    assert (buffer.run, buffer.available) == (2, (0, 100))
    buffer.add_block(2, block(0, steps=40))
    assert buffer.available == (0, 40)


def test_the_buffer_knows_an_excitation_that_came_before_its_run() -> None:
    buffer = ExperimentBuffer(capacity=1000)
    buffer.add_block(1, block(0))
    buffer.add_excitation(excitation(0, 80, run=2))
    assert buffer.experiment is None
    buffer.add_block(2, block(0))
    assert buffer.experiment == (0, 80)


def test_the_buffer_keeps_an_excitation_whose_end_has_its_number_and_the_first_of_several_ends() -> None:
    buffer = ExperimentBuffer(capacity=1000)
    buffer.add_block(1, block(0))
    for answer in (excitation(100, 500), excitation(130, 0), excitation(170, 0), excitation(200, 0, accepted=False)):
        buffer.add_excitation(answer)
    assert buffer.experiment == (100, 130)


def test_excitations_of_strangers_take_bounded_memory() -> None:
    """Answers to excitations of runs to come, each with texts of any length."""
    buffer = ExperimentBuffer(capacity=1000)
    buffer.add_block(1, block(0))
    for number in range(KEPT_EXCITATIONS + 100):
        answer = SimpleNamespace(
            run=2 + number, id=number, kind="x" * 1000, accepted=False, message="x" * 100_000, first_step=0, steps=9
        )
        buffer.add_excitation(answer_from_message(answer))
    assert len(buffer._excitations) == KEPT_EXCITATIONS
    assert max(len(kept.message) + len(kept.kind) for kept in buffer._excitations) < 3_000
    buffer.add_excitation(excitation(0, 80))
    assert buffer.experiment == (0, 80)


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=12), st.integers(0, 40), st.integers(0, 90))
def test_coverage_agrees_with_a_set_of_steps(blocks: list[tuple[int, int]], first_step: int, stop: int) -> None:
    coverage, known = StepCoverage(), set()
    for start, steps in blocks:
        coverage.add(start, steps)
        known |= set(range(start, start + steps))
    missing = {step for start, end in coverage.missing(first_step, stop) for step in range(start, end)}
    assert missing == set(range(first_step, stop)) - known
    assert (coverage.first, coverage.stop) == ((min(known), max(known) + 1) if known else (0, 0))


def test_gaps_are_told_in_words() -> None:
    assert describe_gaps([(100, 200)]) == "steps 100 to 199"
    assert describe_gaps([(0, 1), (5, 7)]) == "steps 0 and 5 to 6"
    assert describe_gaps([(0, 1), (5, 7), (10, 12), (20, 30), (40, 50)]) == (
        "steps 0, 5 to 6, 10 to 11 and 2 more spans"
    )
