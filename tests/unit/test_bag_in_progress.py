"""A recording in progress: what waits until its beginning is known, and what a slow or full disk does to it."""

from __future__ import annotations

import resource
import threading
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.ground.errors import BagError
from amb_core.recording import BagWriter, Recording
from amb_ident_node.bag_in_progress import BagInProgress
from amb_ident_node.completeness import Mark
from amb_ident_node.message_queue import Loss

STATE = "some_msgs/msg/State"


def message(step: int) -> bytes:
    """A serialized message with one field, uint64 step."""
    return b"\x00\x01\x00\x00" + step.to_bytes(8, "little")


def recording(folder: Path, kind: type[BagWriter] = BagWriter, **options: Any) -> BagInProgress:
    writer = kind(folder, chunk_age=60.0)
    writer.add_topic("/state", STATE, "uint64 step")
    return BagInProgress(writer, **options)


def steps(folder: Path) -> list[int]:
    return [item.step for item in Recording.read(folder).messages_of("/state")]


def test_what_ends_before_the_beginning_is_left_out(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag")
    for step in (90, 100, 110):
        bag.write("/state", message(step), Mark(7, step + 1))
    bag.begin(Mark(7, 101), {})
    bag.write("/state", message(95), Mark(7, 96))
    bag.write("/state", message(120), Mark(7, 121))
    bag.close()
    assert steps(tmp_path / "bag") == [110, 120]


def test_a_present_state_that_was_heard_while_the_recording_began_is_written_once(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag")
    bag.write("/state", message(100), Mark(7, 101))
    bag.begin(Mark(7, 100), {"/state": message(100)})
    bag.write("/state", message(150), Mark(7, 151))
    bag.close()
    assert steps(tmp_path / "bag") == [100, 150]


def test_present_states_come_first(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag")
    bag.write("/state", message(150), Mark(7, 151))
    bag.begin(Mark(7, 100), {"/state": message(100)})
    bag.close()
    assert steps(tmp_path / "bag") == [100, 150]


class StallingWriter(BagWriter):
    """Its disk takes nothing while the gate is closed."""

    gate = threading.Event()

    def flush(self) -> None:
        self.gate.wait()
        super().flush()


def test_a_disk_that_stalls_does_not_hold_up_who_writes(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag", StallingWriter, flush_period=0.0)
    bag.begin(None, {})
    assert all(bag.write("/state", message(step)) for step in range(1000))
    StallingWriter.gate.set()
    bag.close()
    assert steps(tmp_path / "bag") == list(range(1000))
    assert bag.trouble == ""


def test_after_the_end_nothing_is_taken(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag")
    bag.begin(None, {})
    bag.write("/state", message(0))
    bag.end()
    assert bag.write("/state", message(1))
    bag.close()
    assert steps(tmp_path / "bag") == [0]
    assert bag.trouble == ""


def test_a_check_that_fails_ends_the_recording_with_a_whole_bag(tmp_path: Path) -> None:
    room = iter([True, False])

    def require_room() -> None:
        if not next(room):
            raise BagError("no room")

    bag = recording(tmp_path / "bag", flush_period=60.0, check=require_room)
    bag.begin(None, {})
    assert bag.write("/state", message(0), steps=1)
    bag.flush()
    assert bag.write("/state", message(1), steps=1)
    bag.flush()
    assert not bag.write("/state", message(2), steps=1)
    assert bag.trouble == "no room; not in the bag: 1 messages of /state (1 steps)"
    bag.close()
    assert steps(tmp_path / "bag") == [0, 1]
    assert Recording.read(tmp_path / "bag").truncated == ""


def test_what_a_full_disk_does_not_take_is_counted_exactly(tmp_path: Path) -> None:
    bag = recording(tmp_path / "bag", flush_period=60.0)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    rng = np.random.default_rng(1)
    try:
        bag.begin(None, {})
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, limits[1]))
        for _ in range(500):
            bag.write("/state", b"\x00\x01\x00\x00" + rng.bytes(10_000), steps=1)  # cannot be compressed
        bag.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    kept = Recording.read(tmp_path / "bag")
    assert kept.truncated
    assert kept.messages == bag.messages > 200
    assert bag.dropped == {"/state": Loss(500 - kept.messages, 500 - kept.messages)}
    assert "cannot be written: File too large; not in the bag: " in bag.trouble
