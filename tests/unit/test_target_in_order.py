"""Telemetry from a link that loses, repeats and reorders: each step once, in order, and every gap counted."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.rig.link import InOrder, TelemetryBlock

ROWS = 20


def block(first: int, rows: int = ROWS) -> TelemetryBlock:
    values = np.arange(first, first + rows, dtype=np.float64)[:, None]
    return TelemetryBlock(first, first // ROWS, values, values + 0.5, -values)


def steps(blocks: list[TelemetryBlock]) -> list[int]:
    return [int(step) for item in blocks for step in item.reference[:, 0]]


@pytest.mark.parametrize("seed", range(5))
def test_gaps_are_those_of_the_link_to_the_sample(seed: int) -> None:
    rng, order = np.random.default_rng(seed), InOrder(wait=10 * ROWS)
    sent = [block(ROWS * number) for number in range(2000)]
    lost = set(np.flatnonzero(rng.random(2000) < 0.01).tolist()) - {0, 1999}
    arriving = [(number + 2.5 * (rng.random() < 0.005), item) for number, item in enumerate(sent) if number not in lost]
    doubled = [entry for entry in arriving if rng.random() < 0.005]
    passed = []
    for _, item in sorted(arriving + doubled, key=lambda entry: entry[0]):
        passed += order.add(item)
    passed += order.flush()
    steps_seen = steps(passed)
    assert steps_seen == [
        step for number in range(2000) if number not in lost for step in range(20 * number, 20 * number + 20)
    ]
    count = order.count
    assert (count.lost, count.doubled, count.late) == (ROWS * len(lost), ROWS * len(doubled), 0)
    assert {first // ROWS for start, stop in count.gaps for first in range(start, stop, ROWS)} == lost
    assert count.reordered == sum(number != int(number) for number, _ in arriving)


def test_a_block_after_its_wait_is_late_and_not_passed_on() -> None:
    order = InOrder(wait=40)
    passed = [step for first in (0, 40, 60, 80, 20, 100) for step in steps(order.add(block(first)))]
    assert passed == [*range(20), *range(40, 120)]
    assert (order.count.lost, order.count.late, order.count.doubled) == (20, 20, 0)


def test_of_a_block_that_overlaps_the_rest_is_passed_on() -> None:
    order = InOrder()
    steps_seen = steps(order.add(block(0))) + steps(order.add(block(10)))
    assert steps_seen == list(range(30))
    assert order.count.doubled == 10


def test_what_waits_stays_bounded_while_a_block_is_missing() -> None:
    order = InOrder(wait=100)
    order.add(block(0))
    passed = [len(order.add(block(first))) for first in range(40, 4000, ROWS)]
    assert passed[:5] == [0, 0, 0, 0, 5]
    assert set(passed[5:]) == {1}


def test_a_wrong_step_far_ahead_does_not_end_the_stream() -> None:
    order = InOrder(wait=40)
    passed = steps(order.add(block(0)))
    passed += steps(order.add(block(10**9)))  # with a right checksum: somebody made it
    for first in range(20, 200, ROWS):
        passed += steps(order.add(block(first)))
    assert passed == list(range(200))
    assert (order.count.implausible, order.count.lost) == (1, 0)


def test_a_stream_that_has_jumped_indeed_goes_on_from_its_second_block() -> None:
    order = InOrder(wait=40)
    passed = steps(order.add(block(0)))
    for first in (10**6, 10**6 + 20, 10**6 + 40, 10**6 + 60, 10**6 + 80):
        passed += steps(order.add(block(first)))
    assert passed == [*range(20), *range(10**6 + 20, 10**6 + 100)]
    assert order.count.lost == 10**6
