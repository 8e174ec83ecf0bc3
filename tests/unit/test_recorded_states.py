"""Regions in bags: of a machine of several axes, and states of version 0.1."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis.recorded_data import recorded_data
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.ground.errors import ParameterError
from amb_core.loop.records import LoopRecord
from amb_core.plant.machine import machine_of
from amb_core.plant.parameters import PlantParameters, RotorParameters
from amb_core.recording import BagWriter, Recording
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.recording.messages.machine import fill_machine
from amb_core.recording.messages.region_state import fill_region_state
from amb_core.regions import AxisState, BearingState, Onset, Region, RegionState

FOLDER = Path(__file__).parents[2] / "amb_msgs" / "msg"
NEW = get_typestore(Stores.ROS2_JAZZY)
for file in FOLDER.glob("*.msg"):
    NEW.register(get_types_from_msg(file.read_text(), f"amb_msgs/msg/{file.stem}"))
OLD = get_typestore(Stores.ROS2_JAZZY)  # of version 0.1, with axes x and y
OLD.register(
    get_types_from_msg((Path(__file__).parent / "data" / "RegionState_0_1.msg").read_text(), "amb_msgs/msg/RegionState")
)
NAME = "amb_msgs/msg/RegionState"
ONSET = Onset(950, 0.095, 147.0, False)


def message(types: Any, name: str, **values: Any) -> Any:
    """A message whose other fields are zero or empty."""
    kind = types.types[name]
    fields: dict[str, Any] = {}
    for field, (node, detail) in types.fielddefs[name][1]:
        if int(node) == 1:  # a base type
            fields[field] = {"string": "", "bool": False}.get(detail[0], 0)
        else:
            fields[field] = message(types, detail) if int(node) == 2 else []
    return kind(**fields | values)


def write_bag(folder: Path, types: Any, *messages: Any) -> Path:
    """A bag with each type of message on a topic of its own."""
    with BagWriter(folder) as bag:
        for name in dict.fromkeys(content.__msgtype__ for content in messages):
            definition, _ = types.generate_msgdef(name, ros_version=2)
            bag.add_topic(f"/amb/{name.rsplit('/')[-1]}", name, definition)
        for number, content in enumerate(messages):
            name = content.__msgtype__
            bag.write(f"/amb/{name.rsplit('/')[-1]}", bytes(types.serialize_cdr(content, name)), number)
    return folder


def test_a_state_of_version_0_1_is_read_with_axes_x_and_y(tmp_path: Path) -> None:
    since = message(OLD, "amb_msgs/msg/RegionOnset", step=950, time=0.095, input_frequency=147.0)
    y = message(OLD, "amb_msgs/msg/AxisRegion", region=1, since=since, bias=-7e-5, input_frequency=200.0)
    old = message(OLD, NAME, run=3, step=1_099, region=1, since=since, y=y, radius=8e-5, settled=True)
    (state,) = Recording.read(write_bag(tmp_path / "bag", OLD, old)).regions(3)
    assert (state.step, state.region, state.since, state.radius, state.settled) == (1_099, Region.B, ONSET, 8e-5, True)
    assert [(axis.name, axis.region) for axis in state.axes] == [("x", Region.A), ("y", Region.B)]
    assert (state.axis("y").bias, state.axis("y").input_frequency) == (-7e-5, 200.0)
    assert math.isnan(state.axis("y").even_distortion)
    assert state.bearings == ()


@pytest.mark.parametrize("axes", [("x", "y"), ("x_a", "y_a", "x_b", "y_b", "z")])
def test_a_state_comes_back_from_a_bag_as_it_was(tmp_path: Path, axes: tuple[str, ...]) -> None:
    states = tuple(AxisState(Region(n % 3), ONSET, *[0.1 * n] * 8, sampling_beat=False, name=axis)
                   for n, axis in enumerate(axes))  # fmt: skip
    state = RegionState(1_099, states, (BearingState("a", Region.B, 8e-5),), Region.C, ONSET, 8e-5, True)
    written = fill_region_state(
        message(NEW, NAME),
        lambda: message(NEW, "amb_msgs/msg/AxisRegion"),
        lambda: message(NEW, "amb_msgs/msg/BearingRegion"),
        state,
        run=3,
        sample_time=1e-4,
    )
    (read,) = Recording.read(write_bag(tmp_path / "bag", NEW, written)).regions(3)
    assert repr(read) == repr(state)


# -- telemetry of a machine of four axes


def write_machine(folder: Path, with_machine: bool = True) -> Path:
    """A run in which y_b drifts from 1 s on and is 220 um from the centre after 2 s; clearances of 200 um."""
    steps = 22_000
    position = np.random.default_rng(2).normal(scale=0.05e-6, size=(steps, 4))
    position[:, 3] -= 20e-6 * np.clip(np.arange(steps) / 1e4 - 1.0, 0.0, None)
    position[20_000:, 3] = 220e-6
    record = LoopRecord(0, 1e-4, np.zeros((steps, 4)), position, np.zeros((steps, 4)))
    machine = machine_of(PlantParameters(rotor=RotorParameters(model="rigid", backup_bearing_radius=200e-6)))
    blocks = [
        fill_loop_samples(
            message(NEW, "amb_msgs/msg/LoopSamples"),
            lambda: message(NEW, "amb_msgs/msg/AxisSamples"),
            7,
            record.window(first, 1_000),
        )
        for first in range(0, steps, 1_000)
    ]
    for part in (axis for block in blocks for axis in block.axes):
        for signal in ("reference", "position", "current"):
            setattr(part, signal, np.array(getattr(part, signal)))
    described = fill_machine(
        message(NEW, "amb_msgs/msg/Machine"),
        lambda: message(NEW, "amb_msgs/msg/MachineAxis"),
        lambda: message(NEW, "amb_msgs/msg/MachineBearing"),
        machine,
    )
    for axis in described.axes:
        axis.direction = np.array(axis.direction)
    return write_bag(folder, NEW, *([described] if with_machine else []), *blocks)


def test_a_run_is_classified_with_the_bearings_of_its_machine(tmp_path: Path) -> None:
    classified = classify_run(Recording.read(write_machine(tmp_path / "bag"))).classification
    assert {axis: set(onsets) for axis, onsets in classified.axis_onsets.items()} == {
        "x_a": set(), "y_a": set(), "x_b": {Region.D}, "y_b": {Region.B, Region.D}
    }  # fmt: skip
    assert classified.onsets[Region.D].step == 20_000
    assert [(bearing.name, bearing.region) for bearing in classified.states[-1].bearings] == [
        ("a", Region.A), ("b", Region.D)
    ]  # fmt: skip


def test_the_data_of_a_run_have_the_axes_of_its_machine(tmp_path: Path) -> None:
    data = recorded_data(Recording.read(write_machine(tmp_path / "bag")))
    assert data.output_names == ("x_a", "y_a", "x_b", "y_b")
    assert data.input_names == ("i_x_a", "i_y_a", "i_x_b", "i_y_b")
    assert data.input_units == ("A",) * 4 and data.output_units == ("m",) * 4
    assert data.experiments[0].outputs.shape == (22_000, 4)


def test_a_run_whose_machine_is_not_recorded_has_bearings_by_names(tmp_path: Path) -> None:
    classified = classify_run(Recording.read(write_machine(tmp_path / "bag", with_machine=False))).classification
    assert set(classified.onsets) == {Region.B}, "220 um are less than the default clearance"
    assert [bearing.name for bearing in classified.states[-1].bearings] == ["a", "b"]


def test_the_command_names_the_axes(tmp_path: Path) -> None:
    arguments = ["regions", str(write_machine(tmp_path / "bag")), "--out", str(tmp_path / "out"), "--axes", "y_b"]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {part: list(onsets) for part, onsets in summary["onsets"].items()} == {
        "rotor": ["B", "D"], "x_a": [], "y_a": [], "x_b": ["D"], "y_b": ["B", "D"]
    }  # fmt: skip
    with pytest.raises(ParameterError, match="--axes y is not allowed; the axes of the run: x_a, y_a, x_b, y_b"):
        CliRunner().invoke(app, [*arguments[:-1], "y"], catch_exceptions=False)
