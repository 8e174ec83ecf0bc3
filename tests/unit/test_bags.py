"""Bags: what is written is read back, by others too; what is cut off reads up to the cut; what is wrong is named."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

import amb_core
from amb_bringup.cli import app
from amb_core.ground.errors import BagError
from amb_core.loop.control import ControllerParameters
from amb_core.recording import BagWriter, Recording, read_overview, read_runs
from tests.bag_messages import TYPES, definition
from tests.written_bags import (
    BLOCK,
    EVENT,
    LOOP_SAMPLES,
    PLANT_STATE,
    SIGNALS,
    STATUS,
    block,
    plant_state,
    serialize,
    signal,
    status,
    write_telemetry,
)


@pytest.fixture
def bag_folder(tmp_path: Path) -> Path:
    return write_telemetry(tmp_path / "bag", [(1, BLOCK * k) for k in range(50)])


def test_samples_come_back_bit_for_bit(bag_folder: Path) -> None:
    bag = Recording.read(bag_folder)
    record = bag.telemetry()
    steps = np.arange(50 * BLOCK)
    assert (record.first_step, record.steps, record.sample_time) == (0, 50 * BLOCK, 1e-4)
    for axis, name in enumerate("xy"):
        np.testing.assert_array_equal(record.reference[:, axis], signal(f"reference_{name}", steps))
        np.testing.assert_array_equal(record.position[:, axis], signal(f"position_{name}", steps))
        np.testing.assert_array_equal(record.current[:, axis], signal(f"current_{name}", steps))
    assert bag.truncated == ""
    assert [(topic.name, topic.type, topic.messages) for topic in bag.topics] == [("/amb/telemetry", LOOP_SAMPLES, 50)]
    assert bag.duration == pytest.approx(0.49)


def test_rosbags_reads_the_same_messages(bag_folder: Path) -> None:
    with AnyReader([bag_folder]) as reader:
        stored = [reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages()]
        assert reader.connections[0].digest == TYPES.hash_rihs01(LOOP_SAMPLES)
    assert [message.first_step for message in stored] == [BLOCK * k for k in range(50)]


def test_metadata_has_what_ros2_bag_info_asks_for(bag_folder: Path) -> None:
    information = yaml.safe_load((bag_folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["bag_0.mcap"]
    assert information["message_count"] == 50
    assert information["starting_time"]["nanoseconds_since_epoch"] == 10**9
    assert information["duration"]["nanoseconds"] == 49 * 10**7
    (topic,) = information["topics_with_message_count"]
    assert topic["topic_metadata"]["serialization_format"] == "cdr"
    assert topic["topic_metadata"]["offered_qos_profiles"][0]["reliability"] == "reliable"


def test_a_file_reads_without_its_folder(bag_folder: Path) -> None:
    assert Recording.read(bag_folder / "bag_0.mcap").telemetry().steps == 50 * BLOCK


def test_the_last_run_is_the_default(tmp_path: Path) -> None:
    bag = Recording.read(write_telemetry(tmp_path / "bag", [(4, 0), (4, 100), (5, 0)]))
    assert bag.runs == [4, 5]
    assert bag.telemetry().steps == BLOCK
    assert bag.telemetry(run=4).steps == 2 * BLOCK
    with pytest.raises(BagError, match="holds no run 9; its runs: 4, 5"):
        bag.telemetry(run=9)


def test_order_and_repetition_of_blocks_do_not_matter(tmp_path: Path) -> None:
    record = Recording.read(write_telemetry(tmp_path / "bag", [(1, 100), (1, 0), (1, 100), (1, 200)])).telemetry()
    np.testing.assert_array_equal(record.position[:, 0], signal("position_x", np.arange(300)))


def test_missing_steps_are_named(tmp_path: Path) -> None:
    bag = Recording.read(write_telemetry(tmp_path / "bag", [(1, 0), (1, 200), (1, 500)]))
    with pytest.raises(BagError, match=r"run 1: telemetry: steps 100 to 199 and 300 to 499 are missing \(300 of 600\)"):
        bag.telemetry()
    assert bag.telemetry(first_step=210, stop=290).steps == 80


def test_steps_beyond_the_data_are_named(bag_folder: Path) -> None:
    with pytest.raises(BagError, match=r"steps 5000 to 5099 are missing.*from step 0 to 4999"):
        Recording.read(bag_folder).telemetry(first_step=4900, stop=5100)


def test_a_restarted_simulator_is_noticed(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        message = TYPES.deserialize_cdr(block(1, 0), LOOP_SAMPLES)
        writer.write("/amb/telemetry", serialize(message), 1)
        message.axes[0].position = message.axes[0].position + 1e-6
        writer.write("/amb/telemetry", serialize(message), 2)
    with pytest.raises(BagError, match="occurs twice with different samples"):
        Recording.read(tmp_path / "bag").telemetry()


def test_excitations_are_those_of_the_run(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/rig/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        writer.add_topic("/rig/excitation_status", STATUS, definition(STATUS))
        writer.write("/rig/excitation_status", status(1, 0, 10), 1)
        writer.write("/rig/excitation_status", status(2, 50, 500), 2)
        writer.write("/rig/excitation_status", status(2, 70, 500, accepted=False), 3)
        writer.write("/rig/telemetry", block(2, 0), 4)
    excitations = Recording.read(tmp_path / "bag").excitations()
    assert [(item.first_step, item.steps, item.accepted) for item in excitations] == [(50, 500, True), (70, 500, False)]


def test_states_of_the_plant_come_back_as_arrays_by_step_and_bearing(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/plant_state", PLANT_STATE, definition(PLANT_STATE))
        for number, (run, step) in enumerate([(4, 0), (5, 0), (5, 20_020), (5, 20_040)]):
            writer.write("/amb/plant_state", plant_state(run, step), number)
    bag = Recording.read(tmp_path / "bag")
    record = bag.plant_states()
    assert record.step.tolist() == [0, 20_020, 20_040]
    np.testing.assert_allclose(record.time, record.step * 1e-4, rtol=1e-15)
    assert record.coil_current[1, 1].tolist() == pytest.approx([20_020.4, 20_020.5, 20_020.6, 20_020.7])
    assert record.flux_density.shape == (3, 2, 8)
    assert record.force[1].tolist() == [[20_020.0, -20_020.0], [20_021.0, -20_021.0]]
    assert record.position[1, 1].tolist() == pytest.approx([0.020021, -0.020021])
    assert record.contact.tolist() == [[False, True]] * 3
    assert record.contact_force[1].tolist() == [40_040.0, 40_042.0]
    assert bag.plant_states(run=4).step.tolist() == [0]
    with pytest.raises(BagError, match=r"holds no states of the plant .* of run 9; the simulator publishes them if"):
        bag.plant_states(run=9)


def test_states_of_the_plant_with_arrays_of_wrong_size_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/plant_state", PLANT_STATE, definition(PLANT_STATE))
        writer.write("/amb/plant_state", plant_state(4, 0, coil_currents=7), 1)
    with pytest.raises(BagError, match="states of the plant in run 4: the arrays of each must have the sizes"):
        Recording.read(tmp_path / "bag").plant_states()


def test_parameters_are_the_last_known_per_node(tmp_path: Path) -> None:
    first = {
        "proportional_gain": 2e4,
        "derivative_on": "error",
        "clip": True,
        "block": 100,
        "unset": None,
        "axes": ["x", "y"],
        "tones": [10.0, 20.0],
        "steps": [1, 2],
        "flags": [True, False],
    }
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/parameter_events", EVENT, definition(EVENT))
        writer.write_parameters("/parameter_events", "/amb/pd_controller", first, 1)
        writer.write_parameters("/parameter_events", "/amb/pd_controller", {"proportional_gain": 3e4}, 2)
        writer.write_parameters("/parameter_events", "/amb/simulator", {"gravity": False}, 3)
    bag = Recording.read(tmp_path / "bag")
    assert bag.parameters() == {
        "/amb/pd_controller": first | {"proportional_gain": 3e4},
        "/amb/simulator": {"gravity": False},
    }
    assert bag.controller_parameters() == ControllerParameters(proportional_gain=3e4)


@pytest.mark.parametrize("mode", ["sqlite3", "compressed file", "compressed messages"])
def test_other_bags_of_ros2_bag_record_are_read(tmp_path: Path, mode: str) -> None:
    plugin = StoragePlugin.SQLITE3 if mode == "sqlite3" else StoragePlugin.MCAP
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    if mode != "sqlite3":
        compression = CompressionMode.FILE if mode == "compressed file" else CompressionMode.MESSAGE
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/amb/telemetry", LOOP_SAMPLES, typestore=TYPES)
        for k in range(5):
            writer.write(connection, k, block(3, BLOCK * k))
    bag = Recording.read(tmp_path / "bag")
    assert bag.runs == [3]
    assert bag.telemetry().steps == 5 * BLOCK


def test_a_database_file_reads_without_metadata(tmp_path: Path) -> None:
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/amb/telemetry", LOOP_SAMPLES, typestore=TYPES)
        writer.write(connection, 1, block(3, 0))
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert Recording.read(tmp_path / "bag").telemetry().steps == BLOCK


def test_split_bags_are_read_in_order(tmp_path: Path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for number in range(12):
        part = write_telemetry(tmp_path / f"part_{number}", [(1, BLOCK * number)])
        (part / f"part_{number}_0.mcap").rename(folder / f"split_{number}.mcap")
    assert Recording.read(folder).telemetry().steps == 12 * BLOCK


def wrong_bags(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    yield tmp_path / "nowhere", "there is no such file or folder"
    (tmp_path / "empty").mkdir()
    yield tmp_path / "empty", "holds neither"
    (tmp_path / "text.txt").write_text("no bag")
    yield tmp_path / "text.txt", "not a bag"
    (tmp_path / "text.mcap").write_text("this is not an MCAP file")
    yield tmp_path / "text.mcap", "not an MCAP file"
    (tmp_path / "text.db3").write_text("this is not a database, though it is long enough to be looked at")
    yield tmp_path / "text.db3", "cannot be read"
    (tmp_path / "void.mcap").touch()
    yield tmp_path / "void.mcap", "no message can be read"
    lost = write_telemetry(tmp_path / "lost", [(1, 0)])
    (lost / "lost_0.mcap").unlink()
    yield lost, "lists lost_0.mcap, which does not exist"


def test_what_is_no_bag_is_named(tmp_path: Path) -> None:
    for path, reason in wrong_bags(tmp_path):
        with pytest.raises(BagError, match=reason) as caught:
            Recording.read(path)
        assert str(tmp_path) in str(caught.value)


def test_without_telemetry_the_topics_that_are_there_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/excitation_status", STATUS, definition(STATUS))
        writer.write("/amb/excitation_status", status(1, 0, 10), 1)
    bag = Recording.read(tmp_path / "bag")
    with pytest.raises(BagError, match=r"holds no telemetry .*; its topics: /amb/excitation_status"):
        bag.telemetry()
    assert bag.runs == []


def test_telemetry_on_two_topics_is_ambiguous(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for rig in ("/rig1/telemetry", "/rig2/telemetry"):
            writer.add_topic(rig, LOOP_SAMPLES, definition(LOOP_SAMPLES))
            writer.write(rig, block(1, 0), 1)
    with pytest.raises(BagError, match="more than one topic: /rig1/telemetry, /rig2/telemetry"):
        Recording.read(tmp_path / "bag").telemetry()


def test_a_message_that_does_not_decode_is_an_error(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        writer.write("/amb/telemetry", block(1, 0)[:200], 1)
    with pytest.raises(BagError, match="cannot be decoded"):
        Recording.read(tmp_path / "bag").telemetry()


def test_a_folder_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="exists already"):
        BagWriter(tmp_path)


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot be made: Not a directory"):
        BagWriter(tmp_path / "file" / "bag")


def test_a_recorded_list_of_the_controller_is_read(tmp_path: Path) -> None:
    given = ControllerParameters(nominal_reference=(0.0, 40e-6))
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/parameter_events", EVENT, definition(EVENT))
        writer.write_parameters("/parameter_events", "/amb/pd_controller", given.model_dump(), 1)
    assert Recording.read(tmp_path / "bag").controller_parameters() == given


def test_telemetry_of_version_0_1_is_read(tmp_path: Path) -> None:
    """It had two axes with a field for each signal, and the sample rate among the parameters of the controller."""
    old = get_typestore(Stores.ROS2_JAZZY)
    text = (Path(__file__).parent / "data" / "LoopSamples_0_1.msg").read_text()
    old.register(get_types_from_msg(text, LOOP_SAMPLES))
    header = old.types["std_msgs/msg/Header"](old.types["builtin_interfaces/msg/Time"](0, 0), "")
    samples = {name: signal(name, np.arange(BLOCK)) for name in SIGNALS}
    message = old.types[LOOP_SAMPLES](header=header, run=3, first_step=0, sample_time=5e-5, **samples)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/amb/telemetry", LOOP_SAMPLES, old.generate_msgdef(LOOP_SAMPLES, ros_version=2)[0])
        writer.add_topic("/parameter_events", EVENT, definition(EVENT))
        given = {"sample_rate": 20e3, "proportional_gain": 3e4, "nominal_reference_y": 40e-6}
        writer.write_parameters("/parameter_events", "/amb/pd_controller", given, 1)
        writer.write("/amb/telemetry", bytes(old.serialize_cdr(message, LOOP_SAMPLES)), 2)
    bag = Recording.read(tmp_path / "bag")
    record = bag.telemetry(3)
    assert record.axes == ("x", "y")
    np.testing.assert_array_equal(record.position[:, 1], samples["position_y"])
    np.testing.assert_array_equal(record.current[:, 0], samples["current_x"])
    assert bag.machine() is None
    expected = ControllerParameters(sample_rate=20e3, proportional_gain=3e4, nominal_reference=(0.0, 40e-6))
    assert bag.controller_parameters() == expected


def test_the_index_shows_what_a_bag_holds_without_its_messages(bag_folder: Path, monkeypatch) -> None:
    recording = Recording.read(bag_folder)
    monkeypatch.setattr("amb_core.recording.storage.McapStorage.messages", None)  # nothing reads them
    shown = read_overview(bag_folder)
    assert (shown.topics, shown.duration, shown.messages, shown.damage) == (
        recording.topics,
        recording.duration,
        50,
        "",
    )


def test_a_bag_without_an_index_is_counted(bag_folder: Path) -> None:
    (file,) = bag_folder.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-2_000])
    recording, shown = Recording.read(bag_folder), read_overview(bag_folder)
    assert (shown.topics, shown.duration, shown.damage) == (recording.topics, recording.duration, recording.truncated)
    assert "incomplete" in shown.damage


def test_bag_info_shows_runs_only_if_asked(bag_folder: Path) -> None:
    brief = CliRunner().invoke(app, ["bag", "info", str(bag_folder)])
    assert "50 messages" in " ".join(brief.output.split())
    assert "/amb/telemetry" in brief.output
    assert "steps 0 to" not in brief.output
    assert "steps 0 to" in CliRunner().invoke(app, ["bag", "info", str(bag_folder), "--runs"]).output


def test_the_runs_of_a_bag_are_those_of_its_recording_and_no_sample_is_kept(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        bag.add_topic("/amb/excitation_status", STATUS, definition(STATUS))
        bag.write("/amb/excitation_status", status(5, 100, 200), 0)
        for number, (run, step) in enumerate([(4, 0), (5, 0), (5, 100), (4, 100), (5, 200), (5, 400)]):
            bag.write("/amb/telemetry", block(run, step), number)
    recording = Recording.read(tmp_path / "bag")
    runs, model = read_runs(tmp_path / "bag")
    assert [run.run for run in runs] == recording.runs == [4, 5]
    assert [run.excitations for run in runs] == [recording.excitations(run.run) for run in runs]
    assert [(run.audit.first, run.audit.stop, run.audit.gaps()) for run in runs] == [
        (0, 200, []),
        (0, 500, [(300, 400)]),
    ]
    assert (runs[1].sample_time, model) == (1e-4, None)
    shown = " ".join(CliRunner().invoke(app, ["bag", "info", str(tmp_path / "bag"), "--runs"]).output.split())
    assert "steps 0 to 199, 0.02 s" in shown and "steps 0 to 499, 100 missing" in shown


@pytest.mark.parametrize("custom", [["x"], {"written_by": 1}, {"other": "x"}, "x"], ids=str)
def test_an_overview_names_the_program_and_version_that_wrote_the_bag(custom: object, bag_folder: Path) -> None:
    assert read_overview(bag_folder).written_by == f"amb_core {amb_core.__version__}"
    shown = CliRunner().invoke(app, ["bag", "info", str(bag_folder)]).output
    assert f"written by amb_core {amb_core.__version__}" in " ".join(shown.split())
    metadata = bag_folder / "metadata.yaml"
    content = yaml.safe_load(metadata.read_text())
    content["rosbag2_bagfile_information"]["custom_data"] = custom
    metadata.write_text(yaml.safe_dump(content))
    assert read_overview(bag_folder).written_by == ""
