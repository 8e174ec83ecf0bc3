"""Runs of one bag with machines, gains and thresholds of their own: each run is read with what was in force then."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter, Recording
from amb_core.regions import Region
from tests.bag_messages import MACHINE, PARAMETERS, TELEMETRY, definition, machine_message, telemetry

RATE, STEPS, BLOCK = 10_000.0, 10_000, 100
CLEARANCE = {1: 250e-6, 2: 500e-6, 3: 800e-6}  # m, by run
GAIN = {1: 20e3, 2: 35e3, 3: 50e3}  # A/m
TOPICS = {"/amb/machine": MACHINE, "/amb/telemetry": TELEMETRY, "/parameter_events": PARAMETERS}


def machine(run: int) -> bytes:
    axes = tuple(
        MachineAxis(name, "A", float("nan"), float("nan"), direction, 3.0, 3.0)
        for name, direction in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)))
    )
    return machine_message(Machine("rig", "simulator", RATE, axes, (MachineBearing("A", CLEARANCE[run]),)))


def blocks(run: int) -> list[bytes]:
    """A run of 1 s in which x moves by 300 um."""
    position = np.random.default_rng(run).normal(scale=1e-8, size=(STEPS, 2))
    position[:, 0] += 300e-6 * np.sin(2.0 * np.pi * 50.0 * np.arange(STEPS) / RATE)
    record = LoopRecord(0, 1.0 / RATE, np.zeros((STEPS, 2)), position, np.zeros((STEPS, 2)))
    return [telemetry(record.window(first, BLOCK), run) for first in range(0, STEPS, BLOCK)]


def messages(late: bool) -> Iterator[tuple[str, bytes | int]]:
    """Topics and data of three runs; of `/parameter_events` the run whose gain it sets.

    The controller publishes the last block of a run when the next one has its machine and gain already. `late`: those
    of the first run are recorded after its first half.
    """
    described = {run: [("/amb/machine", machine(run)), ("/parameter_events", run)] for run in CLEARANCE}
    last: list[tuple[str, bytes]] = []
    for run, changes in described.items():
        samples = [("/amb/telemetry", block) for block in blocks(run)]
        first = samples[: len(samples) // 2] if late and run == 1 else []
        yield from [*first, *changes, *last, *samples[len(first) : -1]]
        last = samples[-1:]
    yield from last


def write_runs(folder: Path, late: bool = False) -> Path:
    with BagWriter(folder) as bag:
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind, definition(kind))
        for number, (topic, data) in enumerate(messages(late)):
            time = 10**18 + 10**7 * number
            if isinstance(data, int):
                bag.write_parameters(topic, "/amb/pd_controller", {"proportional_gain": GAIN[data]}, time)
            else:
                bag.write(topic, data, time)
            if number % 10 == 9:
                bag.flush()
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_runs(tmp_path_factory.mktemp("runs") / "bag")


@pytest.mark.parametrize("stretch", [{}, {"first_step": 2_000, "steps": 1_000}], ids=["whole", "stretch by index"])
@pytest.mark.parametrize("run", [1, 2, 3, None])
def test_a_run_is_read_with_its_own_clearance_and_controller(
    run: int | None, stretch: dict[str, int], bag: Path
) -> None:
    loop = read(bag, run=run, **stretch)
    assert loop.data.clearance == {"x": CLEARANCE[run or 3], "y": CLEARANCE[run or 3]}
    assert loop.controller.proportional_gain == GAIN[run or 3]


@pytest.mark.parametrize(("run", "highest"), [(1, Region.D), (2, Region.A)])
def test_a_rotor_beyond_the_bearing_of_its_run_is_in_region_d(run: int, highest: Region, bag: Path) -> None:
    states = classify_run(Recording.read(bag), run).classification.states
    assert max(state.region for state in states) == highest


@pytest.mark.parametrize("damaged", [False, True], ids=["with an index", "without one"])
def test_an_exported_run_has_its_own_clearance(damaged: bool, bag: Path, tmp_path: Path) -> None:
    file, out = tmp_path / "runs.mcap", tmp_path / "run.mat"
    content = next(bag.glob("*.mcap")).read_bytes()
    file.write_bytes(content[: -len(content) // 6] if damaged else content)
    options = ["--run", "1", "--mat", "--out", str(out)]
    assert CliRunner().invoke(app, ["bag", "export", str(file), *options]).exit_code == 0
    assert read(out, controller="none").data.clearance == {"x": CLEARANCE[1], "y": CLEARANCE[1]}


def test_what_is_recorded_a_little_late_is_of_the_run_in_progress(tmp_path: Path) -> None:
    recording = Recording.read(write_runs(tmp_path / "bag", late=True))
    assert recording.machine(1).clearances["x"] == CLEARANCE[1]
    assert recording.controller(1).proportional_gain == GAIN[1]


def test_what_is_recorded_only_after_a_run_is_taken_for_want_of_better(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder) as bag:
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind, definition(kind))
        for time, data in enumerate([*blocks(1)[:3], *blocks(2)[:3]]):
            bag.write("/amb/telemetry", data, time)
        for time, run in ((10, 2), (11, 3)):
            bag.write("/amb/machine", machine(run), time)
            bag.write_parameters("/parameter_events", "/amb/pd_controller", {"proportional_gain": GAIN[run]}, time)
    recording = Recording.read(folder)
    assert recording.machine(1).clearances["x"] == CLEARANCE[2], "the first one published since"
    assert recording.machine(2).clearances["x"] == CLEARANCE[3], "the last one published, as for a bag of one run"
    assert recording.controller(1).proportional_gain == GAIN[3]


def test_parameters_that_were_recorded_later_complete_those_of_a_run(tmp_path: Path) -> None:
    """The recorder writes all parameters of a node that answered late, after a change of one of them."""
    with BagWriter(tmp_path / "bag") as bag:
        for topic, kind in TOPICS.items():
            bag.add_topic(topic, kind, definition(kind))
        bag.write_parameters("/parameter_events", "/amb/pd_controller", {"proportional_gain": GAIN[1]}, 0)
        for time, run in ((1, 1), (2, 1), (3, 2), (5, 2)):
            bag.write("/amb/telemetry", blocks(run)[time], time)
        everything = {"proportional_gain": GAIN[2], "derivative_gain": 40.0}
        bag.write_parameters("/parameter_events", "/amb/pd_controller", everything, 4)
    recording = Recording.read(tmp_path / "bag")
    assert recording.parameters_of("pd_controller", 1) == {"proportional_gain": GAIN[1], "derivative_gain": 40.0}
    assert recording.parameters_of("pd_controller", 2) == everything
