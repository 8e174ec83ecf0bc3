"""A recording in progress: what is held back until it is known where it begins."""

from __future__ import annotations

from pathlib import Path

from amb_core.recording import BagWriter, Recording
from amb_ident_node.bag_in_progress import BagInProgress
from amb_ident_node.completeness import Mark

STATE = "some_msgs/msg/State"


def message(step: int) -> bytes:
    """A serialized message with one field, uint64 step."""
    return b"\x00\x01\x00\x00" + step.to_bytes(8, "little")


def recording(folder: Path) -> BagInProgress:
    writer = BagWriter(folder)
    writer.add_topic("/state", STATE, "uint64 step")
    return BagInProgress(writer)


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
