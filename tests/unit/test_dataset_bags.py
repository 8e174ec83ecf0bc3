"""Data from bags: telemetry or the topics of the loop, split at what is missing; what does not fit is refused."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amb_core.data.analysis import read, recorded_data
from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import BagError, IdentificationError
from amb_core.recording import Recording
from tests.written_bags import BLOCK, write_telemetry

TYPES = get_typestore(Stores.ROS2_JAZZY)
for file in (Path(__file__).parents[2] / "amb_msgs" / "msg").glob("*.msg"):
    TYPES.register(get_types_from_msg(file.read_text(), f"amb_msgs/msg/{file.stem}"))

SAMPLE_TIME = 1e-4
POSITION, CURRENT = "amb_msgs/msg/RotorPosition", "amb_msgs/msg/CurrentReference"
TELEMETRY, STATUS = "amb_msgs/msg/LoopSamples", "amb_msgs/msg/ExcitationStatus"
Message = tuple[str, str, dict[str, Any]]


def position(run: int, step: int, topic: str = "/rig/position", sample_time: float = SAMPLE_TIME) -> Message:
    axes = np.array([1.0 * step, -1.0 * step])
    return topic, POSITION, {"run": run, "step": step, "time": step * sample_time, "position": axes}


def current(run: int, step: int, topic: str = "/rig/current_reference") -> Message:
    return topic, CURRENT, {"run": run, "step": step, "current": np.array([step + 0.5, -step - 0.5])}


def telemetry(run: int, first_step: int, steps: int = 100) -> Message:
    step = np.arange(first_step, first_step + steps, dtype=np.float64)
    time = TYPES.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    axes = [
        TYPES.types["amb_msgs/msg/AxisSamples"](
            name=name, reference=sign * 2.0 * step, position=sign * step, current=sign * (step + 0.5)
        )
        for name, sign in (("x", 1.0), ("y", -1.0))
    ]
    header = TYPES.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    content = {"header": header, "run": run, "first_step": first_step, "sample_time": SAMPLE_TIME, "axes": axes}
    return "/rig/telemetry", TELEMETRY, content


def status(run: int, first_step: int, steps: int) -> Message:
    content = {"run": run, "id": 1, "kind": "square", "accepted": True, "message": ""}
    return "/rig/excitation_status", STATUS, content | {"first_step": first_step, "steps": steps}


def write(folder: Path, messages: Iterable[Message]) -> Path:
    """A bag as `ros2 bag record` makes it."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[tuple[str, str], Any] = {}
        for number, (topic, kind, content) in enumerate(messages):
            if (topic, kind) not in connections:
                connections[topic, kind] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic, kind], number, TYPES.serialize_cdr(TYPES.types[kind](**content), kind))
    return folder


def loop(run: int, steps: Iterable[int]) -> list[Message]:
    return [message for step in steps for message in (position(run, step), current(run, step))]


def spans(data: IdentificationData) -> list[tuple[int, int]]:
    return [(item.first_step, item.stop) for item in data.experiments]


def assert_samples(data: IdentificationData) -> None:
    """The samples are those of their steps."""
    for item in data.experiments:
        step = np.arange(item.first_step, item.stop, dtype=np.float64)
        np.testing.assert_array_equal(item.outputs, np.column_stack([step, -step]))
        np.testing.assert_array_equal(item.inputs, np.column_stack([step + 0.5, -step - 0.5]))
        if item.reference is not None:
            np.testing.assert_array_equal(item.reference, np.column_stack([2.0 * step, -2.0 * step]))


def test_telemetry_of_the_last_run_is_read_and_gaps_split_it(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", [telemetry(1, 0), *(telemetry(2, step) for step in (0, 100, 300, 700))])
    data = read(bag).data
    assert spans(data) == [(0, 200), (300, 400), (700, 800)]
    assert [gap.steps for gap in data.gaps] == [100, 300]
    assert data.experiments[0].source == f"{bag}, run 2"
    assert data.sample_time == SAMPLE_TIME
    assert_samples(data)
    assert spans(read(bag, run=1).data) == [(0, 100)]
    assert spans(read(bag, first_step=150, steps=200).data) == [(150, 200), (300, 350)]


def read_bag(path: Path, **options: Any) -> IdentificationData:
    return recorded_data(Recording.read(path), **options)


def test_samples_that_are_not_finite_are_left_out_where_that_is_asked_for(tmp_path: Path) -> None:
    topic, kind, content = telemetry(1, 0)
    content["axes"][1].position[40] = np.nan
    bag = write(tmp_path / "bag", [(topic, kind, content)])
    assert spans(read(bag).data) == [(0, 100)]
    assert spans(read(bag, repair="split").data) == [(0, 40), (41, 100)]


def test_the_last_experiment_is_the_default(tmp_path: Path) -> None:
    data = read_bag(write(tmp_path / "bag", [status(1, 120, 300), *(telemetry(1, 100 * k) for k in range(6))]))
    assert spans(data) == [(120, 420)]


def identical(one: IdentificationData, other: IdentificationData) -> bool:
    pairs = zip(one.experiments, other.experiments, strict=True)
    return all(np.array_equal(a.signals, b.signals) and a.first_step == b.first_step for a, b in pairs)


@pytest.mark.parametrize("run", [1, 2, None])
def test_a_stretch_is_read_by_the_index_and_nothing_else(tmp_path: Path, run: int | None) -> None:
    bag = write_telemetry(tmp_path / "bag", [(number, BLOCK * k) for number in (1, 2) for k in range(200)])
    chosen = {"run": run, "first_step": 9_050, "steps": 700}
    whole = recorded_data(Recording.read(bag), **chosen)
    file = bag / "bag_0.mcap"
    content = bytearray(file.read_bytes())
    for place in (0.06, 0.34, 0.59, 0.84):  # before and after the stretch in both runs
        content[int(place * len(content))] ^= 0xFF
    file.write_bytes(content)
    assert Recording.read(bag).truncated.count("is damaged") == 4
    loop = read(bag, **chosen)
    assert loop.damage == ""
    assert identical(loop.data, whole)


def test_steps_that_the_index_does_not_find_are_looked_for_in_the_whole_bag(tmp_path: Path) -> None:
    blocks = [(1, BLOCK * k) for k in range(100)]
    bag = write_telemetry(tmp_path / "bag", [*blocks[:50], *blocks[80:], *blocks[50:80]])
    chosen = {"run": 1, "first_step": 4_500, "steps": 1_000}
    assert identical(read(bag, **chosen).data, recorded_data(Recording.read(bag), **chosen))
    with pytest.raises(BagError, match="does not hold steps 20000 to 20099; it has steps 0 to 9999"):
        read(bag, run=1, first_step=20_000, steps=100)


def test_positions_and_currents_are_paired_by_step(tmp_path: Path) -> None:
    missing = {5, 40, 41}
    messages = [position(3, step) for step in range(100) if step != 5]
    messages += [current(3, step) for step in reversed(range(110)) if step not in {40, 41}]
    data = read_bag(write(tmp_path / "bag", [*loop(2, range(5)), *messages, current(3, 50)]))
    assert spans(data) == [(0, 5), (6, 40), (42, 100)]
    assert sum(gap.steps for gap in data.gaps) == len(missing)
    assert data.sample_time == SAMPLE_TIME
    assert data.experiments[0].reference is None
    assert_samples(data)
    assert spans(read_bag(tmp_path / "bag", run=2)) == [(0, 5)]
    assert spans(read_bag(tmp_path / "bag", first_step=50, steps=10)) == [(50, 60)]


def test_topics_can_be_named_where_there_are_several(tmp_path: Path) -> None:
    extra = [position(1, step, "/other/position") for step in range(10)]
    bag = write(tmp_path / "bag", [*loop(1, range(10)), *extra])
    with pytest.raises(BagError, match="on more than one topic: /other/position, /rig/position; name one as position_"):
        read_bag(bag)
    assert_samples(read_bag(bag, position_topic="/rig/position"))


def test_named_topics_go_before_telemetry(tmp_path: Path) -> None:
    data = read_bag(
        write(tmp_path / "bag", [telemetry(1, 0), *loop(1, range(10))]), current_topic="/rig/current_reference"
    )
    assert spans(data) == [(0, 10)]


@pytest.mark.parametrize(
    ("messages", "options", "message"),
    [
        ([status(1, 0, 10)], {}, "holds neither telemetry .* nor amb_msgs/msg/RotorPosition; its topics: /rig/excit"),
        ([position(1, 0)], {}, "nor amb_msgs/msg/CurrentReference; its topics: /rig/position"),
        ([position(1, 0), current(2, 0)], {}, r"have no run in common \(runs 1 and runs 2\)"),
        (
            [*(position(1, k) for k in range(10)), *(current(1, k) for k in range(100, 110))],
            {},
            r"do not belong together: of 10 positions \(steps 0 to 9\) and 10 currents \(steps 100 to 109\)",
        ),
        (loop(1, range(10)), {"run": 7}, "hold no run 7; their runs: runs 1"),
        (loop(1, range(10)), {"position_topic": "/no"}, "holds no topic /no; its topics: /rig/current_reference"),
        (loop(1, range(10)), {"position_topic": "/rig/current_reference"}, "is of type amb_msgs/msg/CurrentReference;"),
        (loop(1, range(10)), {"first_step": 5, "steps": 20}, "does not hold steps 5 to 24; it has steps 0 to 9"),
        (loop(1, range(1)), {}, "one message does not determine the sample time"),
        ([*loop(1, range(10)), position(1, 10, sample_time=2e-4), current(1, 10)], {}, "irregular sample time: step"),
        (
            [position(1, k, sample_time=0.0) for k in range(9)] + [current(1, k) for k in range(9)],
            {},
            "times must rise",
        ),
        (
            [*loop(1, range(10)), ("/rig/position", POSITION, position(1, 4)[2] | {"position": np.zeros(2)})],
            {},
            "step 4 occurs twice with different values",
        ),
        ([telemetry(1, 0)], {"run": 7}, "holds no run 7; its runs: 1"),
        ([telemetry(1, 0), telemetry(1, 300)], {"first_step": 100, "steps": 200}, "does not hold steps 100 to 299"),
        ([telemetry(1, 0)], {"first_step": 50, "steps": 100}, "does not hold steps 50 to 149; it has steps 0 to 99"),
    ],
)
def test_topics_that_do_not_fit_are_refused_in_one_line(
    tmp_path: Path, messages: list[Message], options: dict[str, Any], message: str
) -> None:
    with pytest.raises((BagError, IdentificationError), match=message) as refusal:
        read_bag(write(tmp_path / "bag", messages), **options)
    assert "\n" not in str(refusal.value)


def test_a_bag_without_topics_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="its topics: none"):
        read_bag(write(tmp_path / "bag", []))


def test_other_options_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="'position_topic' is not allowed; allowed: inputs, outputs"):
        read(tmp_path, position_topic="/rig/position")
