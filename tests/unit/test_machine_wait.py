"""Telemetry that arrives before its machine waits for it, in order and for a limited time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord
from amb_ident_node.machine_wait import MOST_GIVEN_UP, MOST_MESSAGES, MOST_STEPS, MachineWait, Telemetry

TIMEOUT = 5.0  # s


def machine(*axes: str) -> Machine:
    described = tuple(MachineAxis(name, "a", 0.0, 0.0, (1.0, 0.0, 0.0), 3.0, 3.0) for name in axes)
    return Machine("rig", "bridge", 1e4, described, (MachineBearing("a", 2e-4),))


def block(run: int, first: int, *axes: str, steps: int = 100) -> Telemetry:
    samples = np.zeros((steps, len(axes)))
    return Telemetry(run, LoopRecord(first, 1e-4, samples, samples, samples, axes))


def state(run: int) -> Any:
    """A message without telemetry."""
    return SimpleNamespace(run=run, mode=3)


@pytest.fixture
def wait() -> MachineWait:
    return MachineWait(TIMEOUT)


def test_telemetry_waits_for_its_machine_and_keeps_its_order(wait: MachineWait) -> None:
    messages = [block(1, 0, "x", "y"), block(1, 100, "x", "y"), state(1), block(2, 0, "x", "y")]
    assert [wait.add(message, 0.0) for message in messages] == [[], [], [], []]
    assert (wait.missing, wait.steps) == (("x", "y"), 300)
    assert wait.use(machine("x", "y"), 1.0) == messages
    assert (wait.missing, wait.steps) == ((), 0)
    later = block(2, 100, "x", "y")
    assert wait.add(later, 1.0) == [later]


def test_other_messages_pass_while_nothing_waits(wait: MachineWait) -> None:
    assert wait.add(message := state(1), 0.0) == [message]


def test_a_run_of_other_axes_waits_for_another_machine(wait: MachineWait) -> None:
    wait.use(machine("x", "y"), 0.0)
    first, second = block(1, 0, "x", "y"), block(2, 0, "x_a", "y_a")
    assert wait.add(first, 0.0) == [first]
    assert wait.add(second, 0.0) == []
    assert wait.use(machine("x", "y"), 1.0) == [], "not the machine of these axes"
    assert wait.use(machine("x_a", "y_a"), 2.0) == [second]


def test_other_axes_within_a_run_do_not_wait(wait: MachineWait) -> None:
    wait.use(machine("x", "y"), 0.0)
    wait.add(block(1, 0, "x", "y"), 0.0)
    wrong = block(1, 100, "x_a", "y_a")
    assert wait.add(wrong, 0.0) == [wrong], "the classifier refuses it"


def test_without_a_machine_telemetry_passes_after_the_timeout_and_later_at_once(wait: MachineWait) -> None:
    first, second = block(1, 0, "x", "y"), block(2, 0, "x", "y")
    assert wait.add(first, 10.0) == []
    assert wait.expire(14.9) == []
    assert wait.expire(15.0) == [first]
    assert wait.add(second, 16.0) == [second]


def test_what_waits_is_bounded(wait: MachineWait) -> None:
    large = MOST_STEPS // 2
    messages = [block(1, 0, "x", steps=large), block(1, large, "x", steps=large)]
    assert wait.add(messages[0], 0.0) == []
    assert wait.add(messages[1], 0.0) == messages


def test_the_number_of_messages_that_wait_is_bounded(wait: MachineWait) -> None:
    wait.add(block(1, 0, "x", steps=1), 0.0)
    passed = [wait.add(state(1), 0.0) for _ in range(MOST_MESSAGES)]
    assert [len(messages) for messages in passed if messages] == [MOST_MESSAGES, 1]


def test_axes_that_nobody_described_take_bounded_memory(wait: MachineWait) -> None:
    for number in range(MOST_GIVEN_UP + 10):
        wait.add(block(number, 0, f"x{number}", steps=1), float(number))
        assert len(wait.expire(number + TIMEOUT)) == 1
    assert len(wait._given_up) == MOST_GIVEN_UP


def test_a_second_run_of_axes_without_a_machine_waits_on_its_own(wait: MachineWait) -> None:
    first, second = block(1, 0, "x", "y"), block(2, 0, "x_a", "y_a")
    wait.add(first, 0.0)
    wait.add(second, 1.0)
    assert wait.use(machine("x", "y"), 2.0) == [first]
    assert wait.missing == ("x_a", "y_a")
    assert wait.expire(7.0) == [second]
