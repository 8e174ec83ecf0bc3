"""Exported runs: one stamped sample per row or message, bit for bit, and gaps stay gaps."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.commands.results import new_file
from amb_core.data.analysis import read, read_recording
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.data.experiments import DataDescription, write_data
from amb_core.data.experiments.checks import check_region
from amb_core.ground.errors import AmbError, BagError
from amb_core.ground.files.matlab import load_variables
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.loop.records import LoopRecord, axis_names
from amb_core.recording import BagWriter, Recording
from amb_core.recording.export import RunTelemetry, write_foxglove, write_plotjuggler, write_table
from amb_core.regions import Region
from tests.bag_messages import MACHINE, TELEMETRY, TYPES, definition, machine_message, telemetry

NO_LOOP = DataDescription.of(controller="none")
ENDINGS = (".csv", ".mat", ".parquet")
RATE = 10_000.0


def samples(axes: int = 2, steps: int = 1000, first_step: int = 0, rate: float = RATE) -> LoopRecord:
    """Noise of the size of a bearing's signals: every bit of a double is used."""
    random = np.random.default_rng(axes)
    return LoopRecord(
        first_step,
        1.0 / rate,
        *(random.normal(scale=scale, size=(first_step + steps, axes))[first_step:] for scale in (1e-5, 5e-5, 0.7)),
    )


def write_bag(folder: Path, record: LoopRecord, blocks: list[tuple[int, int]], run: int = 7) -> Path:
    """A bag with the blocks (first step, steps) of a record, in this order."""
    with BagWriter(folder) as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        for number, (first, steps) in enumerate(blocks):
            bag.write("/amb/telemetry", telemetry(record.window(first, steps), run), 10**18 + number)
    return folder


def whole(steps: int, size: int = 100) -> list[tuple[int, int]]:
    return [(first, size) for first in range(0, steps, size)]


def export(bag: Path, out: Path, topics: tuple[str, ...] = ()) -> Path:
    writers = {"_plotjuggler.mcap": write_plotjuggler, "_foxglove.mcap": write_foxglove}
    write = next((writer for end, writer in writers.items() if out.name.endswith(end)), write_table)
    write(RunTelemetry(bag), out, topics)
    return out


@pytest.mark.parametrize("axes", [2, 4, 5])
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_table_identified_again_has_the_same_data_bit_for_bit(ending: str, axes: int, tmp_path: Path) -> None:
    record = samples(axes)
    bag = write_bag(tmp_path / "bag", record, whole(1000))
    table = read(export(bag, tmp_path / f"run{ending}"), NO_LOOP).data
    (experiment,) = table.experiments
    assert table.sample_time == record.sample_time
    assert table.output_names == axis_names(axes)
    assert table.input_names == tuple(f"i_{axis}" for axis in axis_names(axes))
    assert experiment.inputs.tobytes() == record.current.tobytes()
    assert experiment.outputs.tobytes() == record.position.tobytes()
    assert experiment.reference.tobytes() == record.reference.tobytes()


@pytest.mark.parametrize("ending", [".mat", ".parquet"])
def test_an_odd_sample_time_comes_back_bit_for_bit(ending: str, tmp_path: Path) -> None:
    record = samples(rate=3000.0)
    bag = write_bag(tmp_path / "bag", record, whole(1000))
    assert read(export(bag, tmp_path / f"run{ending}"), NO_LOOP).data.sample_time == 1.0 / 3000.0


@pytest.mark.parametrize("ending", ENDINGS)
def test_missing_samples_stay_missing_in_a_table(ending: str, tmp_path: Path) -> None:
    record = samples()
    bag = write_bag(tmp_path / "bag", record, [(0, 300), (500, 500)])
    data = read(export(bag, tmp_path / f"run{ending}"), NO_LOOP).data
    assert [(one.first_step, len(one.outputs)) for one in data.experiments] == [(0, 300), (500, 500)]
    assert data.experiments[1].outputs.tobytes() == record.position[500:].tobytes()


def test_blocks_out_of_order_and_doubled_come_once_and_in_order(tmp_path: Path) -> None:
    record = samples()
    bag = write_bag(tmp_path / "bag", record, [(100, 100), (0, 100), (50, 200), (600, 400), (250, 350), (600, 400)])
    batches = list(RunTelemetry(bag).batches(steps=300))
    assert np.concatenate([batch.position for batch in batches]).tobytes() == record.position.tobytes()
    assert [batch.first_step for batch in batches] == sorted(batch.first_step for batch in batches)


def test_a_part_has_the_samples_from_its_start_up_to_its_end(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(), whole(1000))
    run = RunTelemetry(bag, start=0.0123, end=0.05)
    (part,) = run.batches()
    assert (part.first_step, part.steps, run.steps) == (123, 377, 377)
    with pytest.raises(BagError, match=r"no samples from 1 s to the end; it has samples from 0 s to 0\.1 s"):
        RunTelemetry(bag, start=1.0)


def test_the_last_run_is_exported_unless_another_is_named(tmp_path: Path) -> None:
    record = samples()
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        for run, first in ((3, 0), (2, 400)):
            bag.write("/amb/telemetry", telemetry(record.window(first, 100), run), 10**18 + first)
    assert RunTelemetry(tmp_path / "bag").spans == [(400, 500)]
    assert RunTelemetry(tmp_path / "bag", run=3).spans == [(0, 100)]
    with pytest.raises(BagError, match="holds no run 5; its runs: 3, 2"):
        RunTelemetry(tmp_path / "bag", run=5)


def test_matlab_gets_columns_with_names_and_units(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(), whole(1000))
    content = load_variables(export(bag, tmp_path / "run.mat", ("position",)))
    assert content["x"].shape == (1000, 1)
    assert content["Ts"].item() == 1e-4
    assert [name.item() for name in content["names"].ravel()] == ["time", "x", "y"]
    assert [name.item() for name in content["units"].ravel()] == ["s", "m", "m"]


@pytest.mark.parametrize("axis", ["run", "Ts", "names", "units"])
def test_no_column_for_matlab_has_the_name_of_another_variable(axis: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", replace(samples(1), axes=(axis,)), whole(1000))
    with pytest.raises(BagError, match=f"column '{axis}' has the name of another variable"):
        export(bag, tmp_path / "run.mat")


def test_names_with_commas_and_quotes_are_quoted_in_a_csv_file(tmp_path: Path) -> None:
    record = replace(samples(), axes=("a,b", 'c"d'))
    table = read(export(write_bag(tmp_path / "bag", record, whole(1000)), tmp_path / "run.csv"), NO_LOOP).data
    assert table.output_names == record.axes
    assert table.experiments[0].outputs.tobytes() == record.position.tobytes()


# -- clearances


def write_fall(folder: Path, clearances: Sequence[float] = (140e-6, 200e-6)) -> Path:
    """A bag of a machine with two axes in a bearing each: after 1 s the first lies 150 um beside its centre."""
    steps, random = 20_000, np.random.default_rng(0)
    reference = 5e-6 * np.sin(2.0 * np.pi * 300.0 * np.arange(steps) / RATE)[:, np.newaxis] * np.ones(2)
    position = 0.3 * reference + 5e-8 * random.standard_normal((steps, 2))
    position[steps // 2 :, 0] += 150e-6
    record = LoopRecord(0, 1.0 / RATE, reference, position, 8e3 * (reference - position), ("u", "v"))
    machine = Machine(
        "seesaw", "bridge", RATE,
        tuple(MachineAxis(name, f"at_{name}", 0.0, 0.0, (1.0, 0.0, 0.0), 2.0, 3.0) for name in record.axes),
        tuple(MachineBearing(f"at_{name}", value) for name, value in zip(record.axes, clearances, strict=True)),
    )  # fmt: skip
    with BagWriter(folder) as bag:
        bag.add_topic("/amb/machine", MACHINE, definition(MACHINE))
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        bag.write("/amb/machine", machine_message(machine), 10**18)
        for number, first in enumerate(range(0, steps, 1000)):
            bag.write("/amb/telemetry", telemetry(record.window(first, 1000)), 10**18 + number)
    return folder


def delevitations(path: Path) -> tuple[int | None, bool]:
    """Step at which region D begins, and whether it was judged on every axis."""
    recording, _ = read_recording(path)
    found = classify_run(recording).classification
    onset = found.onsets.get(Region.D)
    return None if onset is None else onset.step, all(found.judged.contact.values())


@pytest.mark.parametrize("ending", [".mat", ".parquet"])
def test_a_table_has_the_verdict_on_delevitation_of_its_bag(ending: str, tmp_path: Path) -> None:
    bag, out = write_fall(tmp_path / "bag"), tmp_path / f"run{ending}"
    assert CliRunner().invoke(app, ["bag", "export", str(bag), f"--{ending[1:]}", "--out", str(out)]).exit_code == 0
    assert read(out, NO_LOOP).data.clearance == read(bag, NO_LOOP).data.clearance == {"u": 140e-6, "v": 200e-6}
    assert delevitations(out) == delevitations(bag) == (10_000, True)


@pytest.mark.parametrize("ending", [".csv", ".mat", ".npz"])
def test_saved_data_have_the_verdict_on_delevitation_of_their_bag(ending: str, tmp_path: Path) -> None:
    bag, out = write_fall(tmp_path / "bag"), tmp_path / f"data{ending}"
    write_data(read(bag, NO_LOOP).data, out)
    assert read(out, NO_LOOP).data.clearance == {"u": 140e-6, "v": 200e-6}
    assert delevitations(out) == delevitations(bag) == (10_000, True)
    assert check_region(read(out, NO_LOOP).data) == check_region(read(bag, NO_LOOP).data)


def test_an_exported_text_is_said_to_lack_the_clearance(tmp_path: Path) -> None:
    bag, out = write_fall(tmp_path / "bag", (140e-6, 140e-6)), tmp_path / "run.csv"
    said = CliRunner().invoke(app, ["bag", "export", str(bag), "--csv", "--out", str(out)]).output
    assert "not in a .csv file: the clearances (u 140 um, v 140 um)" in said
    assert "--clearance 140um" in said


# -- PlotJuggler and Foxglove


def test_plotjuggler_gets_a_standard_message_for_each_sample(tmp_path: Path) -> None:
    record = samples(5)
    bag = write_bag(tmp_path / "bag", record, whole(1000))
    path = export(bag, tmp_path / "run_plotjuggler.mcap")
    recording = Recording.read(path)
    assert {topic.type.split("/")[0] for topic in recording.topics} <= {"sensor_msgs", "std_msgs"}
    messages = list(recording.timed_messages_of("/amb/loop"))
    assert len(messages) == 1000
    time, message = messages[999]
    assert time == 99_900_000
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 99_900_000)
    assert message.name == list(record.axes)
    assert message.position.tobytes() == record.position[999].tobytes()
    assert message.effort.tobytes() == record.current[999].tobytes()


@pytest.mark.parametrize("topics", [(), ("position",), ("current",)])
def test_arrays_for_plotjuggler_are_never_empty(topics: tuple[str, ...], tmp_path: Path) -> None:
    """Before its pull request 927 it reads as many values of each array as there are joints."""
    bag = write_bag(tmp_path / "bag", samples(5), whole(1000))
    recording = Recording.read(export(bag, tmp_path / "run_plotjuggler.mcap", topics))
    joints = [topic.name for topic in recording.topics if topic.type == "sensor_msgs/msg/JointState"]
    assert joints
    for name in joints:
        message = next(iter(recording.messages_of(name)))
        sizes = {len(array) for array in (message.name, message.position, message.velocity, message.effort)}
        assert sizes == {5}
        assert np.isnan(message.velocity).all()


def test_a_bag_for_plotjuggler_is_identified_as_any_bag_of_joint_states(tmp_path: Path) -> None:
    record = samples()
    bag = write_bag(tmp_path / "bag", record, whole(1000))
    path = export(bag, tmp_path / "run_plotjuggler.mcap")
    described = DataDescription.of(
        topics="/amb/loop", inputs="effort[x],effort[y]", outputs="position[x],position[y]", controller="none"
    )
    (experiment,) = read(path, described).data.experiments
    assert experiment.inputs.tobytes() == record.current.tobytes()
    assert experiment.outputs.tobytes() == record.position.tobytes()


@pytest.mark.parametrize("axes", [2, 4, 5])
def test_foxglove_gets_a_field_for_each_axis(axes: int, tmp_path: Path) -> None:
    record = samples(axes)
    bag = write_bag(tmp_path / "bag", record, whole(1000))
    path = export(bag, tmp_path / "run_foxglove.mcap")
    with AnyReader([path]) as reader:  # definitions are in the file
        messages = [
            (time, reader.deserialize(data, connection.msgtype))
            for connection, time, data in reader.messages()
            if connection.topic == "/amb/telemetry"
        ]
    assert [message.step for _, message in messages] == list(range(1000))
    assert [time for time, _ in messages] == list(range(0, 100_000_000, 100_000))
    for index, axis in enumerate(record.axes):
        for name in ("reference", "position", "current"):
            values = np.array([getattr(getattr(message, axis), name) for _, message in messages])
            assert values.tobytes() == np.ascontiguousarray(getattr(record, name)[:, index]).tobytes()


def test_a_gap_breaks_the_lines_of_foxglove_and_is_counted_for_plotjuggler(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(), [(0, 300), (500, 500)])
    fox = list(Recording.read(export(bag, tmp_path / "a_foxglove.mcap")).messages_of("/amb/telemetry"))
    assert len(fox) == 801
    assert [message.step for message in fox if np.isnan(message.x.position)] == [300]
    missing = Recording.read(export(bag, tmp_path / "a_plotjuggler.mcap")).timed_messages_of("/amb/status/missing")
    assert [(time, message.data) for time, message in missing] == [(0, 0), (50_000_000, 200), (99_900_000, 200)]


def test_the_spectrum_shows_the_peak_amplitude_of_a_line(tmp_path: Path) -> None:
    record = samples(steps=20_000)
    line = 3e-5 * np.sin(2.0 * np.pi * 1000.0 * record.time)
    record = LoopRecord(0, record.sample_time, record.reference, np.column_stack([line, 0.1 * line]), record.current)
    bag = write_bag(tmp_path / "bag", record, whole(20_000))
    spectra = list(
        Recording.read(export(bag, tmp_path / "a_foxglove.mcap", ("spectrum",))).messages_of("/amb/spectrum")
    )
    assert len(spectra) == 4  # 8192 samples each, half of them new, and the last ones
    largest = int(np.argmax(spectra[0].x))
    assert spectra[0].frequency[largest] == pytest.approx(1000.0, rel=0.02)  # upper end of the range of the point
    assert spectra[0].x[largest] == pytest.approx(3e-5, rel=0.15)  # a line between two bins of a Hann window
    assert spectra[0].y[largest] == pytest.approx(3e-6, rel=0.15)
    recording = Recording.read(export(bag, tmp_path / "a_plotjuggler.mcap", ("spectrum",)))
    assert max(message.data for message in recording.messages_of("/amb/spectrum/x")) == pytest.approx(3e-5, rel=0.15)


def with_tone(steps: int, first: int, stop: int) -> LoopRecord:
    """Samples of an axis that swings by 50 um at 500 Hz between two steps, and else is at rest."""
    record = samples(1, steps)
    step = np.arange(steps)
    tone = 5e-5 * np.sin(2.0 * np.pi * 500.0 * record.time) * ((step >= first) & (step < stop))
    return replace(record, position=tone[:, np.newaxis])


def largest_amplitude(bag: Path, folder: Path) -> float:
    """The largest amplitude in the spectrum of x for PlotJuggler (m)."""
    recording = Recording.read(export(bag, folder / "run_plotjuggler.mcap", ("spectrum",)))
    return max(message.data for message in recording.messages_of("/amb/spectrum/x"))


@pytest.mark.parametrize("after", [[], [(16_100, 8000)]], ids=["the run ends", "a gap follows"])
def test_the_spectrum_of_a_run_holds_the_end_of_a_stretch(after: list[tuple[int, int]], tmp_path: Path) -> None:
    """The tone fills the last half of the window, and so has half of its amplitude."""
    record = with_tone(24_100, 16_000 - 4096, 16_000)
    bag = write_bag(tmp_path / "bag", record, [*whole(16_000), *after])
    assert largest_amplitude(bag, tmp_path) == pytest.approx(2.5e-5, rel=0.15)


@pytest.mark.parametrize("steps", [300, 1000, 4096, 8000])
@pytest.mark.parametrize("after", [[], [(17_000, 300)]], ids=["the run ends", "a gap follows"])
def test_the_spectrum_of_a_run_holds_a_stretch_shorter_than_a_spectrum(
    after: list[tuple[int, int]], steps: int, tmp_path: Path
) -> None:
    record = with_tone(17_300, 8500, 16_900)
    bag = write_bag(tmp_path / "bag", record, [*whole(8400), (8900, steps), *after])
    assert largest_amplitude(bag, tmp_path) == pytest.approx(5e-5, rel=0.15)


@pytest.mark.parametrize(
    ("steps", "ends"), [(16_384, [8192, 12_288, 16_384]), (16_385, [8192, 12_288, 16_384, 16_385])]
)
def test_samples_at_the_end_of_a_stretch_are_in_one_last_spectrum(steps: int, ends: list[int], tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(1, steps), [(0, steps)])
    path = export(bag, tmp_path / "run_foxglove.mcap", ("spectrum",))
    assert [1 + round(time / 1e5) for time, _ in Recording.read(path).timed_messages_of("/amb/spectrum")] == ends


# -- what may go wrong


def test_a_bag_of_others_is_refused_with_its_topics(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/joints", "std_msgs/msg/Float64", "float64 data\n")
        message = TYPES.types["std_msgs/msg/Float64"](1.0)
        bag.write("/joints", bytes(TYPES.serialize_cdr(message, "std_msgs/msg/Float64")), 1)
    with pytest.raises(BagError, match=r"holds no telemetry of this workbench .*; its topics: /joints"):
        RunTelemetry(tmp_path / "bag")


def test_steps_that_came_twice_with_different_samples_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        for number, record in enumerate((samples(), samples(steps=900, first_step=100))):
            changed = LoopRecord(
                record.first_step, record.sample_time, record.reference, record.position + number, record.current
            )
            bag.write("/amb/telemetry", telemetry(changed), 10**18 + number)
    with pytest.raises(AmbError, match="came twice"), new_file(tmp_path / "run.csv") as part:
        write_table(RunTelemetry(tmp_path / "bag"), part)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("changed", [30, None], ids=["with other samples", "the same"])
def test_a_step_that_comes_again_after_many_blocks_is_compared_too(changed: int | None, tmp_path: Path) -> None:
    record, again = samples(steps=25_000), samples(steps=25_000).window(50, 100)
    record.position[[70, 80]] = np.nan
    again.position[[20, 30]] = np.nan
    if changed is not None:
        again.position[changed] = 0.0
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        for time, part in enumerate([*(record.window(first, 100) for first in range(0, 25_000, 100)), again]):
            bag.write("/amb/telemetry", telemetry(part), time)
    if changed is None:
        assert sum(batch.steps for batch in RunTelemetry(tmp_path / "bag").batches()) == 25_000
    else:
        with pytest.raises(BagError, match="run 1: steps 50 to 149 came twice with different samples"):
            list(RunTelemetry(tmp_path / "bag").batches())


@pytest.mark.parametrize("name", ["run.csv", "run.mat", "run.parquet", "run_plotjuggler.mcap", "run_foxglove.mcap"])
def test_an_interrupted_export_leaves_the_file_of_before(name: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(steps=5000), whole(5000))
    (tmp_path / name).write_text("before")

    def interrupt(stage: str, done: int, total: int | None) -> None:
        if stage == "exporting" and done > 3000:
            raise KeyboardInterrupt

    writers: dict[str, Callable[..., None]] = {
        "run_plotjuggler.mcap": write_plotjuggler,
        "run_foxglove.mcap": write_foxglove,
    }
    with pytest.raises(KeyboardInterrupt), new_file(tmp_path / name, overwrite=True) as part:
        writers.get(name, write_table)(RunTelemetry(bag, progress=interrupt), part)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", name]
    assert (tmp_path / name).read_text() == "before"


@pytest.mark.parametrize("name", ["run.csv", "run.mat", "run.parquet", "run_foxglove.mcap"])
def test_memory_does_not_grow_with_the_recording(name: str, tmp_path: Path) -> None:
    peaks = []
    for steps in (20_000, 80_000):
        bag = write_bag(tmp_path / f"bag_{steps}", samples(steps=steps), whole(steps))
        tracemalloc.start()
        export(bag, tmp_path / f"{steps}_{name}")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]  # the samples alone have four times the size


# -- the command


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["bag", "export", *arguments])
    return result.exit_code, str(result.exception or "") + result.output


def test_the_export_of_a_folder_with_a_dot_in_its_name_keeps_the_whole_name(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "lab.2026-11-30", samples(), whole(1000))
    assert run(str(bag), "--csv")[0] == 0
    assert run(str(bag / "lab.2026-11-30_0.mcap"), "--csv")[0] == 0
    assert (tmp_path / "lab.2026-11-30.csv").exists()
    assert (bag / "lab.2026-11-30_0.csv").exists()


def test_the_command_writes_beside_the_bag_and_overwrites_only_if_told(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(), [(0, 300), (500, 500)])
    code, shown = run(str(bag), "--foxglove", "--layout")
    assert code == 0, shown
    assert "missing in the bag, and left out: steps 300 to 499" in " ".join(shown.split())
    assert {path.name for path in tmp_path.iterdir()} == {"bag", "bag_foxglove.mcap", "bag_foxglove.json"}
    before = (tmp_path / "bag_foxglove.mcap").stat().st_mtime_ns
    assert "exists already; give another name, or --overwrite" in run(str(bag), "--foxglove")[1]
    assert (tmp_path / "bag_foxglove.mcap").stat().st_mtime_ns == before
    assert run(str(bag), "--foxglove", "--layout", "--overwrite", "--from", "10ms")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "give one format: --csv, --mat, --parquet, --plotjuggler, --foxglove"),
        (("--csv", "--mat"), "give one format"),
        (("--csv", "--layout"), "--layout is for --plotjuggler and --foxglove"),
        (("--csv", "--out", "run.mat"), "the file name must end in .csv"),
        (("--csv", "--topics", "region"), "--topics region: there is no such topic in this format; allowed: reference"),
        (("--csv", "--from", "2"), "has no samples from 2 s to the end"),
    ],
)
def test_wrong_requests_are_named_and_leave_nothing(arguments: tuple[str, ...], text: str, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", samples(), whole(1000))
    code, shown = run(str(bag), *arguments)
    assert code == 1
    assert text in shown
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
