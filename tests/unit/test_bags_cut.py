"""Bags that were cut, damaged or not finished read up to there, and say so."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from amb_core.ground.errors import BagError
from amb_core.recording import BagWriter, Recording
from tests.bag_messages import definition
from tests.written_bags import (
    BLOCK,
    LOOP_SAMPLES,
    block,
    write_telemetry,
)


@pytest.fixture
def bag_folder(tmp_path: Path) -> Path:
    return write_telemetry(tmp_path / "bag", [(1, BLOCK * k) for k in range(50)])


@pytest.fixture
def file_bytes(bag_folder: Path) -> bytes:
    return (bag_folder / "bag_0.mcap").read_bytes()


def test_cut_anywhere_it_reads_whole_chunks_or_says_that_nothing_is_left(file_bytes: bytes, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    readable = []
    for length in [
        *range(120),
        *range(120, len(file_bytes) - 1, 997),
        *range(len(file_bytes) - 60, len(file_bytes)),
    ]:
        cut.write_bytes(file_bytes[:length])
        try:
            bag = Recording.read(cut)
        except BagError as problem:
            assert "no message can be read" in str(problem)
            readable.append(0)
            continue
        assert bag.truncated
        assert bag.messages % 10 == 0, "only whole chunks"
        assert bag.telemetry().steps == BLOCK * bag.messages
        readable.append(bag.messages)
    assert readable == sorted(readable)
    assert readable[-1] == 50, "without its index it still reads in full"


def test_a_damaged_chunk_is_not_read(file_bytes: bytes, tmp_path: Path) -> None:
    damaged = bytearray(file_bytes)
    middle = len(damaged) // 2
    damaged[middle : middle + 4] = b"\xff\xff\xff\xff"
    (tmp_path / "damaged.mcap").write_bytes(damaged)
    bag = Recording.read(tmp_path / "damaged.mcap")
    assert bag.truncated
    assert 0 < bag.messages < 50


def test_what_was_flushed_survives_a_kill(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", chunk_age=0.0)
    writer.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
    for k in range(7):
        writer.write("/amb/telemetry", block(1, BLOCK * k), k)
    bag = Recording.read(tmp_path / "bag")
    assert bag.truncated
    assert bag.telemetry().steps == 7 * BLOCK
    writer.close()


def test_a_full_disk_is_an_error_and_leaves_a_readable_bag(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", chunk_age=0.0)
    writer.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
    try:
        with pytest.raises(BagError, match="cannot be written: File too large"):
            for k in range(1000):
                writer.write("/amb/telemetry", block(1, BLOCK * k), k)
        with pytest.raises(BagError, match="cannot be written"):
            writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    bag = Recording.read(tmp_path / "bag")
    assert bag.truncated
    assert bag.telemetry().steps > 0
