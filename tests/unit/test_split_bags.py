"""Bags in several files: split by time or size, each message once, readable after a kill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.highlevel import AnyReader

from amb_core.recording import BagWriter, Recording
from tests.bag_messages import definition
from tests.written_bags import BLOCK, LOOP_SAMPLES, STATUS, block, signal, status


def write_split(folder: Path, **options: float) -> Path:
    """A bag of 60 blocks, one every 10 ms, in more than one file."""
    with BagWriter(folder, **options) as bag:
        bag.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        bag.add_topic("/amb/excitation_status", STATUS, definition(STATUS))
        bag.write("/amb/excitation_status", status(1, 0, 10), 10**9)
        for number in range(60):
            bag.write("/amb/telemetry", block(1, BLOCK * number), 10**9 + 10**7 * number)
    return folder


def described(folder: Path) -> dict[str, Any]:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_a_bag_is_split_by_time_and_every_message_is_in_it_once(tmp_path: Path) -> None:
    """As rosbag2 does: a file has all topics, and no message of the one before."""
    folder = write_split(tmp_path / "bag", split_period=0.1)
    names = [f"bag_{number}.mcap" for number in range(6)]
    assert sorted(file.name for file in folder.glob("*.mcap")) == names
    information = described(folder)
    assert information["relative_file_paths"] == names
    assert [file["path"] for file in information["files"]] == names
    assert [file["message_count"] for file in information["files"]] == [11, 10, 10, 10, 10, 10]
    assert [file["starting_time"]["nanoseconds_since_epoch"] for file in information["files"]] == [
        10**9 + 10**8 * number for number in range(6)
    ]
    assert {file["duration"]["nanoseconds"] for file in information["files"]} == {9 * 10**7}
    assert information["message_count"] == 61
    assert information["duration"]["nanoseconds"] == 59 * 10**7
    counts = {
        item["topic_metadata"]["name"]: item["message_count"] for item in information["topics_with_message_count"]
    }
    assert counts == {"/amb/telemetry": 60, "/amb/excitation_status": 1}

    bag = Recording.read(folder)
    assert bag.messages == 61
    np.testing.assert_array_equal(bag.telemetry().position[:, 0], signal("position_x", np.arange(60 * BLOCK)))
    with AnyReader([folder]) as reader:
        messages = [reader.deserialize(data, item.msgtype) for item, _, data in reader.messages()]
    assert [message.first_step for message in messages if message.__msgtype__ == LOOP_SAMPLES] == [
        BLOCK * number for number in range(60)
    ]
    assert Recording.read(folder / "bag_3.mcap").telemetry().first_step == 30 * BLOCK


def test_a_bag_is_split_by_size(tmp_path: Path) -> None:
    folder = write_split(tmp_path / "bag", split_size=20_000.0, chunk_age=0.0)
    sizes = [file.stat().st_size for file in folder.glob("*.mcap")]
    assert len(sizes) > 3
    assert max(sizes) < 20_000 + 20_000, "the size, one block, and the index with all definitions"
    assert Recording.read(folder).telemetry().steps == 60 * BLOCK
    assert described(folder)["message_count"] == 61


def test_a_split_bag_survives_a_kill(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", chunk_age=0.0, split_period=0.1)
    writer.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
    for number in range(25):
        writer.write("/amb/telemetry", block(1, BLOCK * number), 10**7 * number)
    bag = Recording.read(tmp_path / "bag")
    assert bag.truncated.startswith("bag_2.mcap is incomplete")
    assert bag.telemetry().steps == 25 * BLOCK
    writer.close()
