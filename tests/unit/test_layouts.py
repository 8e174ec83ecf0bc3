"""Layouts of PlotJuggler and Foxglove: every topic and field that they name is in the exported file.

`python tests/unit/test_layouts.py` writes the installed layouts anew.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from amb_core.loop.records import LoopRecord, axis_names
from amb_core.recording import BagWriter, Recording
from amb_core.recording.export import RunTelemetry, write_foxglove, write_plotjuggler
from amb_core.recording.export.layouts import foxglove_layout, plotjuggler_layout, radial_pairs
from tests.bag_messages import TELEMETRY, TYPES, definition, telemetry

FOLDER = Path(__file__).parents[2] / "src" / "amb_bringup" / "layouts"
MACHINES = {"one_bearing": 2, "two_bearings": 4, "two_bearings_and_thrust": 5}
REGION, SIMULATOR = "amb_msgs/msg/RegionState", "amb_msgs/msg/SimulatorState"
STEPS = 10_000


def installed() -> dict[str, str]:
    """The installed layouts by the names of their files."""
    kinds = {"plotjuggler.xml": plotjuggler_layout, "foxglove.json": foxglove_layout}
    return {
        f"{machine}_{end}": draw(axis_names(count))
        for machine, count in MACHINES.items()
        for end, draw in kinds.items()
    }


@pytest.fixture(scope="module", params=MACHINES.values())
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag with all that the layouts show, of 2, 4 or 5 axes."""
    random = np.random.default_rng(1)
    record = LoopRecord(0, 1e-4, *random.normal(scale=1e-5, size=(3, STEPS, request.param)))
    folder = tmp_path_factory.mktemp("layouts") / "bag"
    with BagWriter(folder) as writer:
        for topic, kind in (
            ("/amb/telemetry", TELEMETRY),
            ("/amb/region", REGION),
            ("/amb/simulator/state", SIMULATOR),
        ):
            writer.add_topic(topic, kind, definition(kind))
        writer.write("/amb/telemetry", telemetry(record, run=3), 10**18)
        for number, step in enumerate((1000, 5000)):
            writer.write("/amb/region", _region(record.axes, step), 10**18 + number)
            writer.write("/amb/simulator/state", _simulator(step), 10**18 + number)
    return folder


def test_the_installed_layouts_are_those_of_the_library() -> None:
    assert {path.name: path.read_text(encoding="utf-8") for path in FOLDER.iterdir()} == installed()


def test_every_series_of_plotjuggler_is_in_the_file(bag: Path) -> None:
    run = RunTelemetry(bag)
    path = bag.with_name("run_plotjuggler.mcap")
    path.unlink(missing_ok=True)
    write_plotjuggler(run, path)
    there = _plotjuggler_series(Recording.read(path))
    root = ElementTree.fromstring(plotjuggler_layout(run.axes))
    wanted = [curve.get(name) for curve in root.iter("curve") for name in ("curve_x", "curve_y") if curve.get(name)]
    wanted += [curve.get("name") for curve in root.iter("curve") if curve.get("curve_x") is None]
    assert set(wanted) <= there
    assert {tab.get("tab_name", "").split(" (")[0] for tab in root.iter("Tab")} == {
        "Orbit",
        "Time",
        "Spectrum",
        "Status",
    }
    for splitter in root.iter("DockSplitter"):
        assert len(splitter) == int(splitter.get("count", "0")) == len(splitter.get("sizes", "").split(";"))


def test_series_that_are_drawn_over_each_other_have_the_same_times(bag: Path) -> None:
    run = RunTelemetry(bag)
    path = bag.with_name("pairs_plotjuggler.mcap")
    write_plotjuggler(run, path, ("spectrum",))
    recording = Recording.read(path)
    times = [
        [time for time, _ in recording.timed_messages_of(f"/amb/spectrum/{name}")] for name in ("frequency", *run.axes)
    ]
    assert len(times[0]) > 100
    assert all(other == times[0] for other in times)


def test_every_path_of_foxglove_is_in_the_file(bag: Path) -> None:
    run = RunTelemetry(bag)
    path = bag.with_name("run_foxglove.mcap")
    write_foxglove(run, path)
    recording = Recording.read(path)
    layout = json.loads(foxglove_layout(run.axes))
    panels = layout["configById"]
    paths = [item["value"] for panel in panels.values() for item in panel.get("paths", ())]
    paths += [panel["xAxisPath"]["value"] for panel in panels.values() if "xAxisPath" in panel]
    paths += [panel["topicPath"] for panel in panels.values() if "topicPath" in panel]
    for item in paths:
        topic, fields = re.fullmatch(r"([^.]+)\.?(.*?)(?:\.@mul\(\d+\))?", item).groups()  # type: ignore[union-attr]
        assert _values(next(iter(recording.messages_of(topic))), fields), item
    assert set(_leaves(layout["layout"])) == set(panels)


def test_orbits_are_drawn_for_radial_bearings_only() -> None:
    assert radial_pairs(axis_names(5)) == [("x_a", "y_a"), ("x_b", "y_b")]
    assert radial_pairs(("x", "z")) == []


@pytest.mark.parametrize("axes", [("x", "z"), ("Axis 1", "Axis 2", "header")])
def test_axes_of_any_name_have_a_layout(axes: tuple[str, ...]) -> None:
    ElementTree.fromstring(plotjuggler_layout(axes))
    json.loads(foxglove_layout(axes))


def _plotjuggler_series(recording: Recording) -> set[str]:
    """Names that PlotJuggler gives to the series of a bag of standard messages."""
    series = set()
    for topic in recording.topics:
        message = next(iter(recording.messages_of(topic.name)))
        if topic.type == "sensor_msgs/msg/JointState":
            arrays = [name for name in ("position", "velocity", "effort") if np.isfinite(getattr(message, name)).any()]
            series |= {f"{topic.name}/{joint}/{name}" for joint in message.name for name in arrays}
        else:
            series.add(f"{topic.name}/data")
    return series


def _values(message: Any, fields: str) -> list[Any]:
    """What a path of Foxglove finds in a message: fields, all items of arrays, and those whose field has a value."""
    values = [message]
    for part in filter(None, fields.split(".")):
        name, items, key, value = re.fullmatch(r'(\w+)(\[:\])?(?:\{(\w+)=="(.*)"\})?', part).groups()  # type: ignore[union-attr]
        values = [getattr(item, name) for item in values]
        if items:
            values = [item for array in values for item in array]
        if key:
            values = [item for item in values if getattr(item, key) == value]
    return values


def _leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else [*_leaves(node["first"]), *_leaves(node["second"])]


def _header(step: int) -> Any:
    stamp = TYPES.types["builtin_interfaces/msg/Time"](0, step * 100_000)
    return TYPES.types["std_msgs/msg/Header"](stamp, "")


def _region(axes: tuple[str, ...], step: int) -> bytes:
    onset = TYPES.types["amb_msgs/msg/RegionOnset"](step, step * 1e-4, 10.0, False)
    numbers = [float(number) for number in range(8)]
    parts = [
        TYPES.types["amb_msgs/msg/AxisRegion"](
            axis, 1, onset, *numbers, False, True, onset, False, onset, 0.0, 0.0, 0.0, 0.0, False, ""
        )
        for axis in axes
    ]
    bearing = TYPES.types["amb_msgs/msg/BearingRegion"]("A", 1, 1e-5)
    message = TYPES.types[REGION](_header(step), 3, 1, step, step + 1, 1, onset, 1e-5, True, parts, [bearing])
    return bytes(TYPES.serialize_cdr(message, REGION))


def _simulator(step: int) -> bytes:
    message = TYPES.types[SIMULATOR](_header(step), 3, step, 0, 1, 1e-4, 0, 100, 1)
    return bytes(TYPES.serialize_cdr(message, SIMULATOR))


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in installed().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
