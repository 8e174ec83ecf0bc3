"""Samples of a run in a bag: missing, doubled and out of order are counted, exactly as they were recorded."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from amb_core.ground.errors import BagError
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter, StepAudit, audit_steps
from tests.bag_messages import TELEMETRY, definition, telemetry

BLOCK = 10


def write(folder: Path, blocks: Iterable[tuple[int, int]], **options: float) -> Path:
    """A bag of blocks of telemetry (run, first step)."""
    samples = np.zeros((3, BLOCK, 2))
    with BagWriter(folder, **options) as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        for number, (run, first_step) in enumerate(blocks):
            bag.write("/amb/telemetry", telemetry(LoopRecord(first_step, 1e-4, *samples), run), number)
    return folder


def test_each_sample_once_and_in_order(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", [(run, BLOCK * k) for run in (1, 2) for k in range(20)], split_period=7e-9)
    assert len(list(bag.glob("*.mcap"))) == 6
    audit = audit_steps(bag, 2)
    assert (audit.first, audit.stop, audit.samples) == (0, 200, 200)
    assert (audit.lost(), audit.doubled, audit.out_of_order) == (0, 0, 0)
    assert audit.describe() == "steps 0 to 199, none missing"


def test_what_is_wrong_is_counted(tmp_path: Path) -> None:
    audit = audit_steps(write(tmp_path / "bag", [(1, first) for first in (0, 10, 40, 40, 20, 45)]), 1)
    assert audit.samples == 60
    assert audit.lost() == 10
    assert audit.gaps() == [(30, 40)]
    assert audit.lost(0, 100) == 10 + 45
    assert audit.doubled == 10 + 5
    assert audit.out_of_order == 10 + 10 + 5
    assert audit.describe(0, 60) == (
        "steps 0 to 59, 15 missing (steps 30 to 39 and 55 to 59), 15 doubled, 25 out of order"
    )


def test_a_run_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="holds no run 2"):
        audit_steps(write(tmp_path / "bag", [(1, 0)]), 2)


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(1, 20)), min_size=1, max_size=30))
def test_the_counts_are_those_of_the_single_samples(blocks: list[tuple[int, int]]) -> None:
    audit, seen, doubled, out_of_order = StepAudit(), set(), 0, 0
    for first, steps in blocks:
        audit.add(first, steps)
        before = set(seen)
        for step in range(first, first + steps):
            doubled += step in before
            out_of_order += bool(before) and step <= max(before)
            seen.add(step)
    assert audit.doubled == doubled
    assert audit.out_of_order == out_of_order
    assert audit.lost() == max(seen) - min(seen) + 1 - len(seen)


def peak_memory(bag: Path) -> int:
    """Of an audit (B)."""
    tracemalloc.start()
    try:
        audit_steps(bag, 1)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """Beyond two chunks, of 1 MiB or about 1800 blocks each."""
    short = write(tmp_path / "short", [(1, BLOCK * k) for k in range(4_000)])
    long = write(tmp_path / "long", [(1, BLOCK * k) for k in range(12_000)])
    audit_steps(short, 1)  # loads what is loaded once
    assert peak_memory(long) < peak_memory(short) + 0.5 * (1 << 20)  # of 4.5 MiB more
