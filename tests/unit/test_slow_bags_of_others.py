"""A bag of another program, with stamped messages on two topics, of a loop that is sampled at 250 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from amb_core.data.analysis import read, read_recording
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.ground.errors import IdentificationError, RegionError
from amb_core.identification import identify
from amb_core.loop.control import ControllerParameters

TYPES = get_typestore(Stores.ROS2_JAZZY)
POINT, VECTOR = "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/Vector3Stamped"
SAMPLE_TIME, POLE, FORCE = 4e-3, 20.0, 10.0  # s, 1/s, m/s^2 per A
STEPS = 3_000
COLUMNS = {"inputs": ["i=cmd.vector.x"], "outputs": ["x=pos.point.x"], "reference": ["x=cmd.vector.y"], "units": "m,A"}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stamps are exact, messages are recorded late."""
    rng = np.random.default_rng(0)
    cosh, sinh = np.cosh(POLE * SAMPLE_TIME), np.sinh(POLE * SAMPLE_TIME)
    a = np.array([[cosh, sinh / POLE], [POLE * sinh, cosh]])
    b = FORCE * np.array([(cosh - 1.0) / POLE**2, sinh / POLE])
    reference = np.repeat(1e-4 * rng.choice([-1.0, 1.0], STEPS // 10), 10)
    state, last = np.zeros(2), 0.0
    of = {name: TYPES.types[name] for name in TYPES.types}
    path = tmp_path_factory.mktemp("bags") / "magnet"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        places = writer.add_connection("/rig/pos", POINT, typestore=TYPES)
        commands = writer.add_connection("/rig/cmd", VECTOR, typestore=TYPES)
        for step in range(STEPS):
            position = state[0] + 1e-7 * rng.normal()
            error = reference[step] - position
            current = 100.0 * error + 4.0 * (error - last) / SAMPLE_TIME
            state, last = a @ state + b * current + [0.0, 2e-5 * rng.normal()], error
            at = 1_700_000_000_000_000_000 + step * 4_000_000
            stamp = of["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
            header = of["std_msgs/msg/Header"](stamp=stamp, frame_id="rig")
            point = of[POINT](header=header, point=of["geometry_msgs/msg/Point"](x=position, y=0.0, z=0.0))
            vector = of[VECTOR](
                header=header, vector=of["geometry_msgs/msg/Vector3"](x=current, y=reference[step], z=0.0)
            )
            writer.write(places, at + 10_000 + int(rng.integers(0, 100_000)), TYPES.serialize_cdr(point, POINT))
            writer.write(commands, at + 200_000 + int(rng.integers(0, 100_000)), TYPES.serialize_cdr(vector, VECTOR))
    return path


def test_the_ends_of_names_say_which_topics_belong_together(bag: Path) -> None:
    loop = read(bag, controller="pd:100,4", **COLUMNS)
    assert loop.data.samples == STEPS
    assert loop.data.sample_time == SAMPLE_TIME  # stamps hold ns, which a double of the date does not
    assert loop.data.output_names == ("x",)


@pytest.mark.parametrize(
    ("late", "note"),
    [
        (0.0, ""),
        (0.05, ""),
        (0.3, "/rig/pos is usually 0.3 of a sample before /rig/cmd"),
        (-0.3, "0.3 of a sample after"),
    ],
)
def test_a_topic_whose_stamps_are_between_those_of_the_first_is_named(tmp_path: Path, late: float, note: str) -> None:
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind, values, lag in (("/rig/pos", POINT, "point", 0.0), ("/rig/cmd", VECTOR, "vector", late)):
            of = TYPES.types
            connection = writer.add_connection(topic, kind, typestore=TYPES)
            for step in range(60):
                at = 1_700_000_000_000_000_000 + round((step + lag) * 4_000_000)
                stamp = of["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                header = of["std_msgs/msg/Header"](stamp=stamp, frame_id="")
                content = of[f"geometry_msgs/msg/{'Point' if kind == POINT else 'Vector3'}"](x=step % 5, y=0.0, z=0.0)
                message = of[kind](header=header, **{values: content})
                writer.write(connection, at, TYPES.serialize_cdr(message, kind))
    loop = read(tmp_path / "bag", inputs="i=cmd.vector.x", outputs="x=pos.point.x", units="m,A", controller="none")
    assert loop.described is not None
    lags = [line for line in loop.described.notes if "simultaneous" in line]
    assert note in "".join(lags) and len(lags) == bool(note)


def test_a_name_that_no_topic_has_is_refused_with_those_there_are(bag: Path) -> None:
    with pytest.raises(IdentificationError, match=r"no topic has a column pos.w; there are /rig/.*pos.point.x"):
        read(bag, **{**COLUMNS, "outputs": ["pos.w"]})


def test_a_pd_controller_may_be_slower_than_1_khz(bag: Path) -> None:
    loop = read(bag, controller="pd:100,4", **COLUMNS)
    assert isinstance(loop.controller, ControllerParameters)
    assert loop.controller.sample_rate == pytest.approx(250.0, rel=1e-12)
    model = identify(loop.data, 2, controller=loop.controller).model
    poles = np.sort(np.log(np.abs(np.linalg.eigvals(model.a)))) / SAMPLE_TIME
    assert poles == pytest.approx([-POLE, POLE], rel=0.02)


def test_its_regions_are_those_of_a_slower_loop(bag: Path) -> None:
    recording, _ = read_recording(bag, **COLUMNS)
    classified = classify_run(recording)
    assert {state.region.name for state in classified.classification.states} == {"A"}
    assert classified.longer == pytest.approx(4.0)
    assert classified.parameters.update_interval == pytest.approx(0.04)


def test_a_loop_too_slow_for_regions_is_named_with_its_file(tmp_path: Path) -> None:
    file = tmp_path / "slow.csv"
    time = np.arange(200) / 50.0
    columns = np.column_stack([time, np.sin(time), 1e-6 * np.cos(time), 1e-6 * np.sin(time)])
    np.savetxt(file, columns, delimiter=",", header="time [s],i_x [A],x [m],r_x [m]", comments="")
    recording, _ = read_recording(file)
    with pytest.raises(RegionError, match=r"slow\.csv, run .*not classified at 50 Hz"):
        classify_run(recording)
