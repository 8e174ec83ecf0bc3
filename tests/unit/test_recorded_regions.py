"""Regions of recorded runs: onsets at the known frequency, gaps and delevitation told, bad bags refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read, read_recording
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.data.experiments.checks import check_region
from amb_core.ground.errors import BagError, ParameterError, RegionError
from amb_core.recording import BagWriter, Recording
from amb_core.regions import Region
from amb_core.regions.stretches import stretches
from amb_core.report.pages.recording import recording_report

TYPES = get_typestore(Stores.ROS2_JAZZY)
for file in (Path(__file__).parents[2] / "amb_msgs" / "msg").glob("*.msg"):
    TYPES.register(get_types_from_msg(file.read_text(), f"amb_msgs/msg/{file.stem}"))

OLD = get_typestore(Stores.ROS2_JAZZY)  # of version 0.1, with all samples in the message
OLD.register(
    get_types_from_msg((Path(__file__).parent / "data" / "Excitation_0_1.msg").read_text(), "amb_msgs/msg/Excitation")
)

RATE, BLOCK = 10_000.0, 100
START, STEPS = 5_000, 40_000  # of the excitation, of the run
DRIFT = 20_000  # step from which the bias drifts
TOPICS = {"LoopSamples": "telemetry", "Excitation": "excitation", "ExcitationStatus": "excitation_status"}


def message(name: str, types: Any = TYPES, **values: Any) -> Any:
    kind = types.types[f"amb_msgs/msg/{name}"]
    if "header" in kind.__annotations__:
        time = types.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        values["header"] = types.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    return kind(**values)


def sweep_signals() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frequency, reference and position of a sweep on y from 100 to 800 Hz; from `DRIFT` on the bias sinks 40 um/s."""
    frequency = 100.0 + 200.0 * np.arange(STEPS - START) / RATE
    reference = np.zeros(STEPS)
    reference[START:] = 20e-6 * np.sin(2.0 * np.pi * np.cumsum(frequency) / RATE)
    noise = np.random.default_rng(3).normal(scale=1e-8, size=STEPS)
    drift = -40e-6 * np.maximum(np.arange(STEPS) - DRIFT, 0) / RATE
    return frequency, reference, 0.1 * reference + noise + drift - 66e-6


DEFINITION = {
    "run": 7, "id": 1, "kind": "sweep", "first_step": -1, "sample_time": 1.0 / RATE, "steps": STEPS - START,
    "checksum": 0, "axes": [],
    "description": json.dumps(
        {"amplitude": 20e-6, "duration": 3.5, "axes": "y", "frequency_start": 100.0, "frequency_end": 800.0}
    ),
}  # fmt: skip


def samples_of(axis: str, reference: np.ndarray, position: np.ndarray) -> Any:
    return TYPES.types["amb_msgs/msg/AxisSamples"](
        name=axis, reference=reference, position=position, current=np.zeros(len(position))
    )


def excitation_of_old(reference: np.ndarray, frequency: np.ndarray) -> Any:
    return message(
        "Excitation", OLD, run=7, id=1, kind="sweep", description="{}", first_step=-1, sample_time=1.0 / RATE,
        reference_x=np.zeros(len(reference)), reference_y=reference, frequency=frequency,
    )  # fmt: skip


def write_bag(
    folder: Path,
    missing: tuple[int, int] = (0, 0),
    delevitated: bool = False,
    broken: int | slice | None = None,
    stopped: int | None = None,
    stopped_by: int = 2,
    old: bool = False,
) -> Path:
    frequency, reference, position = sweep_signals()
    if broken is not None:
        position[broken] = np.nan
    zeros = np.zeros(STEPS)
    messages = [
        excitation_of_old(reference[START:], frequency) if old else message("Excitation", **DEFINITION),
        message(
            "ExcitationStatus", run=7, id=1, kind="sweep", accepted=True, message="", first_step=START,
            steps=STEPS - START,
        ),
    ]  # fmt: skip
    for first in range(0, STEPS, BLOCK):
        if not missing[0] <= first < missing[1]:
            part = slice(first, first + BLOCK)
            messages.append(
                message(
                    "LoopSamples", run=7, first_step=first, sample_time=1.0 / RATE,
                    axes=[samples_of("x", zeros[part], zeros[part]), samples_of("y", reference[part], position[part])],
                )
            )  # fmt: skip
    if stopped is not None:
        stop = message(
            "ExcitationStatus",
            run=7,
            id=stopped_by,
            kind="stop",
            accepted=True,
            message="",
            first_step=stopped,
            steps=0,
        )
        messages.append(stop)
    if delevitated:
        messages.append(
            message(
                "SimulatorState",
                run=7,
                step=STEPS,
                last_step=0,
                mode=3,
                sample_time=1.0 / RATE,
                plant_state_steps=0,
                clock_steps=100,
                sequence=0,
            )
        )
    topics = {**TOPICS, "SimulatorState": "simulator/state"}
    with BagWriter(folder) as bag:
        for name, topic in topics.items():
            definition, _ = (OLD if old and name == "Excitation" else TYPES).generate_msgdef(
                f"amb_msgs/msg/{name}", ros_version=2
            )
            bag.add_topic(f"/amb/{topic}", f"amb_msgs/msg/{name}", definition)
        for number, content in enumerate(messages):
            topic = topics[content.__msgtype__.rsplit("/", 1)[-1]]
            types = OLD if old and topic == "excitation" else TYPES
            bag.write(f"/amb/{topic}", bytes(types.serialize_cdr(content, content.__msgtype__)), number)
    return folder


@pytest.mark.parametrize("old", [False, True], ids=["definition", "bag of version 0.1"])
def test_an_onset_has_the_frequency_that_the_excitation_had_there(tmp_path: Path, old: bool) -> None:
    classified = classify_run(Recording.read(write_bag(tmp_path / "bag", old=old)))
    onset = classified.classification.onsets[Region.B]
    assert onset.step == pytest.approx(DRIFT, abs=600)
    assert onset.input_frequency == pytest.approx(100.0 + 200.0 * (onset.step - START) / RATE)
    assert classified.frequency is not None
    assert np.isnan(classified.frequency[:START]).all() and classified.frequency[START] == 100.0
    assert not classified.delevitated and not classified.gaps


@pytest.mark.parametrize(
    "change",
    [
        {"description": "no JSON"},
        {"sample_time": 0.0},
        {"kind": "waveform", "axes": [TYPES.types["amb_msgs/msg/AxisReference"](name="x", reference=np.zeros(10))]},
        {"kind": "of a later version"},
    ],
)
def test_a_definition_that_is_not_understood_leaves_the_frequency_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]
) -> None:
    for name, value in change.items():
        monkeypatch.setitem(DEFINITION, name, value)
    classified = classify_run(Recording.read(write_bag(tmp_path / "bag")))
    assert classified.frequency is None
    assert classified.classification.states


def test_no_region_is_said_of_a_run_that_is_too_short_to_be_classified(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", missing=(2_000, STEPS))
    said = CliRunner().invoke(app, ["regions", str(bag), "--out", str(tmp_path / "out")], catch_exceptions=False).stdout
    assert said.count("not classified") == 3  # rotor, x, y
    assert "too short for B and C: they were not evaluated" in said
    assert "no B, C or D" not in said


def test_a_run_that_delevitated_ends_in_region_d(tmp_path: Path) -> None:
    classified = classify_run(Recording.read(write_bag(tmp_path / "bag", delevitated=True)))
    assert classified.delevitated
    assert classified.classification.states[-1].region is Region.D
    assert classified.classification.onsets[Region.D].step == STEPS


def test_the_classification_restarts_after_a_gap(tmp_path: Path) -> None:
    classified = classify_run(Recording.read(write_bag(tmp_path / "bag", missing=(12_500, 14_000))))
    assert classified.gaps == [(12_500, 14_000)]
    assert (
        np.isnan(classified.record.position[12_500:14_000]).all()
        and np.isfinite(classified.record.position[14_000:]).all()
    )
    parts = stretches(classified.classification.states)
    assert [(part.region.name, part.first_step) for part in parts[:2]] == [("A", 0), ("A", 14_000)]
    assert parts[0].stop <= 12_500
    assert classified.classification.onsets[Region.B].step == pytest.approx(DRIFT, abs=600)


def test_samples_that_are_not_finite_are_told_and_cost_no_more_than_themselves(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", broken=12_345)
    classified = classify_run(Recording.read(bag))
    assert (classified.missing, classified.gaps) == ([], [(12_345, 12_346)])
    parts = stretches(classified.classification.states)
    assert [(part.region.name, part.first_step) for part in parts[:2]] == [("A", 0), ("A", 12_346)]
    assert classified.classification.onsets[Region.B].step == pytest.approx(DRIFT, abs=600)
    result = CliRunner().invoke(app, ["regions", str(bag), "--out", str(tmp_path / "out")], catch_exceptions=False)
    assert "steps 12345 are missing or not finite; the classification" in " ".join(result.stdout.split())


def test_a_run_without_finite_samples_is_refused_by_bag_and_step(tmp_path: Path) -> None:
    with pytest.raises(RegionError, match=r"bag, run 7: telemetry: position y is nan at step 0"):
        classify_run(Recording.read(write_bag(tmp_path / "bag", broken=slice(None))))


def test_a_run_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="holds no run 8; its runs: 7"):
        classify_run(Recording.read(write_bag(tmp_path / "bag")), 8)


def test_a_bag_without_telemetry_is_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        definition, _ = TYPES.generate_msgdef("amb_msgs/msg/SimulatorState", ros_version=2)
        bag.add_topic("/amb/simulator/state", "amb_msgs/msg/SimulatorState", definition)
        content = message(
            "SimulatorState",
            run=7,
            step=0,
            last_step=0,
            mode=0,
            sample_time=1e-4,
            plant_state_steps=0,
            clock_steps=100,
            sequence=0,
        )
        bag.write("/amb/simulator/state", bytes(TYPES.serialize_cdr(content, content.__msgtype__)), 1)
    with pytest.raises(BagError, match=r"holds no telemetry \(amb_msgs/msg/LoopSamples\); its topics: /amb/simulator"):
        classify_run(Recording.read(tmp_path / "bag"))


@pytest.mark.parametrize("by", [1, 2], ids=["by the bridge itself", "by a stop"])
def test_an_excitation_ends_where_it_is_stopped(tmp_path: Path, by: int) -> None:
    bag = write_bag(tmp_path / "bag", stopped=30_000, stopped_by=by)
    frequency = Recording.read(bag).input_frequency(0, STEPS)
    known = np.flatnonzero(np.isfinite(frequency))
    assert (known[0], known[-1]) == (START, 29_999)


def test_a_run_without_an_end_has_no_delevitation(tmp_path: Path) -> None:
    assert Recording.read(write_bag(tmp_path / "bag")).delevitation() is None


def test_the_command_prints_the_onsets_and_writes_figures_and_summary(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", missing=(9_000, 13_000), delevitated=True)
    result = CliRunner().invoke(app, ["regions", str(bag), "--out", str(tmp_path / "out")], catch_exceptions=False)
    assert result.exit_code == 0
    for text in ("steps 9000 to 12999 are missing", "the bias drifts", "at the end in region D"):
        assert text in result.stdout
    assert {path.name for path in (tmp_path / "out").iterdir() if path.suffix} == {
        "plotly.min.js", "summary.json", "sweep.html", "sweep.png",
    }  # fmt: skip
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["gaps"] == [[9_000, 13_000]]
    assert summary["delevitated"] is True
    assert summary["onsets"]["rotor"]["B"]["input_frequency"] == pytest.approx(400.0, abs=12.0)
    assert summary["shares"]["A"] is None, "B and D were found, but the clearance is not known"
    assert 0.0 < summary["shares"]["B"] + summary["shares"]["D"] < 1.0


def test_a_drift_after_a_gap_that_follows_delevitation_is_no_onset_of_the_rotor(tmp_path: Path) -> None:
    steps = np.arange(60_000)
    position = 0.02 * np.random.default_rng(0).standard_normal(len(steps))
    position[10_000:20_000] += 260.0
    position[40_000:] += 20.0 * np.arange(20_000) / RATE
    position[25_000:25_100] = np.nan
    reference = np.where(steps < 5_000, 0.0, 5.0 * np.sin(2.0 * np.pi * 997.0 * steps / RATE))
    table = np.column_stack([steps / RATE, 0.0 * position, position, reference])
    heading = "time [s],i_x [A],x [um],r_x [um]"
    np.savetxt(tmp_path / "two.csv", table, delimiter=",", header=heading, comments="", fmt="%.9g")
    recording, _ = read_recording(tmp_path / "two.csv", clearance="250um", repair="split")
    found = classify_run(recording).classification
    assert set(found.onsets) == {Region.D}
    assert set(found.axis_onsets["x"]) == {Region.B, Region.D}


def write_fall(file: Path) -> None:
    """A table of one axis in um without a word on the clearance: after 1 s the rotor lies 150 um beside the centre."""
    steps, random = 20_000, np.random.default_rng(0)
    reference = 5.0 * np.sin(2.0 * np.pi * 300.0 * np.arange(steps) / RATE)
    position = 0.3 * reference + 0.05 * random.standard_normal(steps)
    position[steps // 2 :] = 150.0 + 0.05 * random.standard_normal(steps // 2)
    table = np.column_stack([np.arange(steps) / RATE, 0.008 * (reference - position), position, reference])
    np.savetxt(file, table, delimiter=",", header="time [s],i_x [A],x [um],r_x [um]", comments="", fmt="%.9g")


def test_a_table_without_a_clearance_is_not_said_to_be_free_of_delevitation(tmp_path: Path) -> None:
    write_fall(tmp_path / "fall.csv")
    command = ["regions", str(tmp_path / "fall.csv"), "--out", str(tmp_path / "out")]
    said = CliRunner().invoke(app, command, catch_exceptions=False).stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "D not judged: the clearance is not known" in said and "--clearance" in said and "D 0.0 %" not in said
    assert summary["shares"]["D"] is None and summary["not_judged"]["D"] == ["x"] and summary["delevitated"] is None
    recording, _ = read_recording(tmp_path / "fall.csv")
    report = recording_report(recording, order=2)
    assert "Region A" not in report.lead and "D not judged: the clearance is not known." in report.lead

    said = CliRunner().invoke(app, [*command, "--clearance", "140um"], catch_exceptions=False).stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "not judged" not in said and "in region D" in said
    assert summary["onsets"]["rotor"]["D"]["step"] == 10_000 and summary["delevitated"] is True
    data = read(tmp_path / "fall.csv", clearance="140um", controller="none").data
    assert check_region(data).what.startswith("region D (delevitated) from step 10000")


def test_positions_that_do_not_count_from_the_centre_are_doubted(tmp_path: Path) -> None:
    steps = np.arange(10_000)
    reference = 300.0 + 5.0 * np.sin(2.0 * np.pi * 300.0 * steps / RATE)
    position = 300.0 + 0.3 * (reference - 300.0) + 0.05 * np.random.default_rng(0).standard_normal(len(steps))
    table = np.column_stack([steps / RATE, 0.008 * (reference - position), position, reference])
    heading = "time [s],i_x [A],x [um],r_x [um]"
    np.savetxt(tmp_path / "off.csv", table, delimiter=",", header=heading, comments="", fmt="%.9g")
    recording, _ = read_recording(tmp_path / "off.csv", clearance="250um")
    assert "does it count from the centre of the bearing?" in classify_run(recording).centre_problem
    assert "does it count from the centre of the bearing?" in recording_report(recording, order=2).lead


def test_the_command_refuses_a_bag_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="nowhere"):
        CliRunner().invoke(app, ["regions", str(tmp_path / "nowhere")], catch_exceptions=False)


def test_the_command_refuses_an_axis_that_the_run_lacks(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag")
    with pytest.raises(ParameterError, match="--axes z is not allowed; the axes of the run: x, y"):
        CliRunner().invoke(
            app, ["regions", str(bag), "--out", str(tmp_path / "out"), "--axes", "z"], catch_exceptions=False
        )
