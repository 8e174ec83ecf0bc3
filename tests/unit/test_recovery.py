"""Damaged bags: what is in whole chunks is recovered, what is lost is named, and whole bags are reported as whole."""

from __future__ import annotations

import random
import resource
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.ground.errors import BagError
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter, Recording, inspect_bag, recover_bag
from tests.bag_messages import TELEMETRY, TYPES, definition, telemetry

BLOCK, CHUNK, CHUNKS = 20, 5, 8  # samples of a block, blocks of a chunk, chunks
TOPIC = "/amb/telemetry"
UNLIMITED = {"sec": 9223372036, "nsec": 854775807}
QOS = {
    "history": "keep_last",
    "depth": 10,
    "reliability": "best_effort",
    "durability": "volatile",
    "deadline": UNLIMITED,
    "lifespan": UNLIMITED,
    "liveliness": "automatic",
    "liveliness_lease_duration": UNLIMITED,
    "avoid_ros_namespace_conventions": False,
}


def block(first_step: int) -> bytes:
    """Samples that cannot be compressed."""
    noise = np.random.default_rng(first_step).normal(size=(3, BLOCK, 2))
    return telemetry(LoopRecord(first_step, 1e-4, *noise), run=7)


def write_bag(folder: Path) -> Path:
    """A bag of our recorder with chunks of `CHUNK` blocks."""
    with BagWriter(folder, chunk_age=60.0) as bag:
        bag.add_topic(TOPIC, TELEMETRY, definition(TELEMETRY))
        for number in range(CHUNKS * CHUNK):
            bag.write(TOPIC, block(BLOCK * number), number)
            if number % CHUNK == CHUNK - 1:
                bag.flush()
    return folder


def write_as_rosbag2(file: Path, **options: object) -> None:
    """A file with the records that `ros2 bag record` writes, under its presets."""
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK * len(block(0)), **options)
        writer.start("ros2", "libmcap 1.0")
        schema = writer.register_schema(TELEMETRY, "ros2msg", definition(TELEMETRY).encode())
        metadata = {"offered_qos_profiles": yaml.safe_dump([QOS]), "topic_type_hash": TYPES.hash_rihs01(TELEMETRY)}
        channel = writer.register_channel(TOPIC, "cdr", schema, metadata)
        writer.add_metadata("rosbag2", {"serialized_metadata": ""})
        for number in range(CHUNKS * CHUNK):
            writer.add_message(channel, number + 1, block(BLOCK * number), number, number)
        writer.finish()


def cut(bag: Path, length: int, folder: Path) -> Path:
    """A bag whose recorder was killed when its file had a length."""
    folder.mkdir()
    (folder / "bag_0.mcap").write_bytes(next(bag.glob("*.mcap")).read_bytes()[:length])
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("whole") / "bag")


def test_a_whole_bag_is_whole(bag: Path) -> None:
    state = inspect_bag(bag)
    assert state.damage == []
    assert state.messages == CHUNKS * CHUNK
    assert state.runs[TOPIC, 7].describe() == f"steps 0 to {CHUNKS * CHUNK * BLOCK - 1}, none missing"


def test_cut_at_any_byte_every_whole_chunk_is_recovered(bag: Path, tmp_path: Path) -> None:
    size = next(bag.glob("*.mcap")).stat().st_size
    lengths = sorted([*random.Random(1).sample(range(size), 30), *range(size - 12, size), 0, 8, 100])
    recovered = []
    for length in lengths:
        state = inspect_bag(cut(bag, length, tmp_path / f"cut_{length}"))
        assert any("incomplete" in text for text in state.damage)
        if state.messages == 0:
            with pytest.raises(BagError, match=r"no message can be read: .*incomplete"):
                recover_bag(state, tmp_path / f"out_{length}")
            assert not (tmp_path / f"out_{length}").exists()
        else:
            made = recover_bag(state, tmp_path / f"out_{length}")
            assert inspect_bag(made).damage == []
            steps = range(0, Recording.read(made).telemetry(7).steps, BLOCK)
            with AnyReader([made]) as reader:
                assert [data for _, _, data in reader.messages()] == [block(first) for first in steps]
            assert len(steps) == state.messages
        recovered.append(state.messages)
        shutil.rmtree(tmp_path / f"cut_{length}")
    assert set(recovered) == set(range(0, CHUNKS * CHUNK + 1, CHUNK)), "whole chunks, each number of them"
    assert recovered == sorted(recovered)
    chunk = size // CHUNKS
    assert all(messages >= CHUNK * (length // chunk - 1) for length, messages in zip(lengths, recovered, strict=True))


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"compression": CompressionType.NONE}, id="none"),
        pytest.param({"compression": CompressionType.ZSTD}, id="zstd"),
        pytest.param({"compression": CompressionType.LZ4}, id="lz4"),
        pytest.param({"use_chunking": False, "enable_crcs": False}, id="fastwrite"),
    ],
)
def test_bags_of_ros2_bag_record_are_recovered(tmp_path: Path, options: dict[str, object]) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    write_as_rosbag2(folder / "bag_0.mcap", **options)
    content = (folder / "bag_0.mcap").read_bytes()
    (folder / "bag_0.mcap").write_bytes(content[: len(content) // 2])
    state = inspect_bag(folder)
    assert CHUNKS * CHUNK / 2 - 2 * CHUNK <= state.messages <= CHUNKS * CHUNK / 2
    made = recover_bag(state, tmp_path / "made")
    with AnyReader([made]) as reader:
        assert [data for _, _, data in reader.messages()] == [block(BLOCK * k) for k in range(state.messages)]
        (connection,) = reader.connections
        assert connection.digest == TYPES.hash_rihs01(TELEMETRY)
    description = yaml.safe_load((made / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    (topic,) = description["topics_with_message_count"]
    assert topic["topic_metadata"]["offered_qos_profiles"] == [QOS]
    assert description["message_count"] == state.messages


@pytest.mark.parametrize("where", [0.01, 0.5])
def test_chunks_behind_a_damaged_one_are_recovered(bag: Path, tmp_path: Path, where: float) -> None:
    """Also if it is the first one, which introduces the topics: the index at the end has them too."""
    damaged = tmp_path / "bag"
    shutil.copytree(bag, damaged)
    content = bytearray((damaged / "bag_0.mcap").read_bytes())
    place = 200 + int(where * len(content))
    content[place : place + 4] = b"\xff\xff\xff\xff"
    (damaged / "bag_0.mcap").write_bytes(content)
    state = inspect_bag(damaged)
    assert state.messages == (CHUNKS - 1) * CHUNK
    assert "bag_0.mcap is damaged: the chunk at byte " in state.damage[0]
    assert state.damage[1] == "metadata.yaml lists 40 messages, and 35 can be read"
    assert inspect_bag(recover_bag(state, tmp_path / "made")).damage == []


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), min_size=1, max_size=20))
def test_whatever_is_damaged_the_rest_is_recovered(bag: Path, tmp_path: Path, places: list[tuple[float, int]]) -> None:
    content = bytearray((bag / "bag_0.mcap").read_bytes())
    for where, value in places:
        content[int(where**3 * (len(content) - 1))] = value  # mostly at the beginning, where the definitions are
    shutil.rmtree(tmp_path / "bag", ignore_errors=True)
    shutil.rmtree(tmp_path / "made", ignore_errors=True)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(content)
    state = inspect_bag(tmp_path / "bag")
    if state.messages:
        made = inspect_bag(recover_bag(state, tmp_path / "made"))
        assert (made.damage, made.messages) == ([], state.messages)
    else:
        with pytest.raises(BagError, match="no message can be read"):
            recover_bag(state, tmp_path / "made")


def test_a_full_disk_leaves_nothing_of_the_copy(bag: Path, tmp_path: Path) -> None:
    state = inspect_bag(cut(bag, next(bag.glob("*.mcap")).stat().st_size - 10, tmp_path / "bag"))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    try:
        with pytest.raises(BagError, match="cannot be written: File too large"):
            recover_bag(state, tmp_path / "made")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not (tmp_path / "made").exists()


def test_files_of_a_split_bag_are_recovered_together(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder, split_period=10e-9) as writer:
        writer.add_topic(TOPIC, TELEMETRY, definition(TELEMETRY))
        for number in range(40):
            writer.write(TOPIC, block(BLOCK * number), number)
    assert inspect_bag(folder).damage == []
    (folder / "metadata.yaml").unlink()
    last = (folder / "bag_3.mcap").read_bytes()
    (folder / "bag_3.mcap").write_bytes(last[:100])
    (folder / "bag_1.mcap").write_bytes(bytes(1000))  # as after a power failure
    state = inspect_bag(folder)
    assert state.messages == 20
    assert "bag_1.mcap: not an MCAP file" in state.damage[0]
    assert state.damage[1].startswith("bag_3.mcap is incomplete: it was not closed, and its last ")
    assert state.damage[2] == "metadata.yaml is missing or cannot be read"
    made = recover_bag(state, tmp_path / "made")
    assert inspect_bag(made).runs[TOPIC, 7].describe() == "steps 0 to 599, 200 missing (steps 200 to 399)"


def test_what_cannot_be_recovered_is_named(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"the folder holds no \.mcap file"):
        inspect_bag(tmp_path)
    with pytest.raises(BagError, match="there is no such file or folder"):
        inspect_bag(tmp_path / "nowhere")
    with pytest.raises(BagError, match="exists already"):
        recover_bag(inspect_bag(bag), tmp_path)


def test_the_command_reports_what_it_found_and_leaves_the_bag_alone(bag: Path, tmp_path: Path) -> None:
    size = next(bag.glob("*.mcap")).stat().st_size
    damaged = cut(bag, size // 2, tmp_path / "night")
    before = (damaged / "bag_0.mcap").read_bytes()
    shown = CliRunner().invoke(app, ["bag", "recover", str(damaged)], catch_exceptions=False)
    assert shown.exit_code == 0
    assert "bag_0.mcap is incomplete: it was not closed, and its last " in shown.output
    assert "/amb/telemetry, run 7: steps 0 to " in shown.output
    assert f"recovered bag: {tmp_path / 'night_recovered'}" in shown.output
    assert (damaged / "bag_0.mcap").read_bytes() == before
    assert [file.name for file in damaged.iterdir()] == ["bag_0.mcap"]
    again = CliRunner().invoke(app, ["bag", "recover", str(tmp_path / "night_recovered")], catch_exceptions=False)
    assert "The bag is whole: every file can be read to its end, and metadata.yaml agrees." in again.output
    noted = CliRunner().invoke(app, ["bag", "info", str(damaged)], catch_exceptions=False)
    assert f"amb bag recover {damaged} makes a whole bag of the rest" in noted.output


def test_nothing_is_said_of_metadata_where_one_file_is_looked_at(bag: Path) -> None:
    shown = CliRunner().invoke(app, ["bag", "recover", str(next(bag.glob("*.mcap")))], catch_exceptions=False)
    assert "The bag is whole: every file can be read to its end." in shown.output


def test_the_recovered_bag_of_a_folder_with_a_dot_in_its_name_keeps_the_whole_name(bag: Path, tmp_path: Path) -> None:
    damaged = cut(bag, next(bag.glob("*.mcap")).stat().st_size // 2, tmp_path / "lab.2026-11-30")
    CliRunner().invoke(app, ["bag", "recover", str(damaged)], catch_exceptions=False)
    assert (tmp_path / "lab.2026-11-30_recovered").is_dir()
