"""Tables of others are read whole, by the columns that are meant and at the rate of their times, or it is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy import io

from amb_core.data.analysis import read
from amb_core.data.experiments import DescribedData, IdentificationData
from amb_core.data.experiments.proposal import UndescribedError
from amb_core.ground.errors import IdentificationError

SAMPLES = 300
TIME = 1e-3 * np.arange(SAMPLES)
U, Y = np.random.default_rng(0).normal(size=(2, SAMPLES))


def text(*columns: Any, heading: str = "", end: str = "") -> str:
    """A table with commas, whose missing values are empty cells."""
    rows = [
        ",".join("" if isinstance(value, float) and np.isnan(value) else f"{value:.17g}" for value in row) + end
        for row in zip(*columns, strict=True)
    ]
    return "\n".join([*[heading] * bool(heading), *rows]) + "\n"


def described(path: Path, content: str, **options: Any) -> DescribedData:
    path.write_text(content)
    loop = read(path, controller="none", **options)
    assert loop.described is not None
    return loop.described


def signals(data: IdentificationData) -> np.ndarray:
    return np.concatenate([item.signals for item in data.experiments])


# -- the last column of a text


@pytest.mark.parametrize("there", [0, 200, 290, 297])
@pytest.mark.parametrize("heading", ["t [s],u [V],y [V],temperature", ""])
def test_a_last_column_that_ends_empty_loses_no_sample(tmp_path: Path, there: int, heading: str) -> None:
    temperature = np.where(np.arange(SAMPLES) < there, 20.5, np.nan)
    content = text(TIME, U, Y, temperature, heading=heading)
    columns = {} if heading else {"time": "0", "inputs": [1], "outputs": [2]}
    data = described(tmp_path / "rig.csv", content, **columns).data
    assert np.array_equal(signals(data), np.column_stack([U, Y]))


def test_a_last_column_that_is_mostly_empty_is_a_column(tmp_path: Path) -> None:
    temperature = np.where(np.arange(SAMPLES) % 10 == 0, 20.5, np.nan)
    content = text(TIME, U, Y, temperature, heading="t,u,y,temperature")
    assert described(tmp_path / "rig.csv", content).data.samples == SAMPLES


@pytest.mark.parametrize("heading", ["t,u,y,", "t,u,y"])
def test_a_separator_at_the_end_of_each_row_is_no_column(tmp_path: Path, heading: str) -> None:
    found = described(tmp_path / "rig.csv", text(TIME, U, Y, heading=heading, end=","))
    assert np.array_equal(signals(found.data), np.column_stack([U, Y]))
    assert not any("not used" in note for note in found.notes)


def test_rows_of_another_number_of_columns_above_the_others_are_refused(tmp_path: Path) -> None:
    content = text(TIME[:200], U[:200], Y[:200]) + text(TIME[200:], U[200:], Y[200:], Y[200:])
    with pytest.raises(IdentificationError, match=r"row 1 of the numbers has 3 columns, the last rows have 4"):
        described(tmp_path / "rig.csv", content, time="0", inputs=[1], outputs=[2])


# -- the first rows of a text


@pytest.mark.parametrize("row", ["nan,nan", ",", "-,NA"])
def test_first_rows_without_a_number_are_no_headings(tmp_path: Path, row: str) -> None:
    found = described(tmp_path / "rig.csv", f"u,y\n{row}\n{row}\n{text(U, Y)}", rate=1e3)
    assert np.array_equal(signals(found.data), np.column_stack([U, Y]))
    assert "rows without a number above the first sample, left out: 2" in found.notes


@pytest.mark.parametrize("heading", ["0,1", "1,2"])
def test_a_first_row_that_counts_the_columns_is_their_heading(tmp_path: Path, heading: str) -> None:
    """As pandas writes columns without names."""
    output = np.where(np.arange(SAMPLES) < 3, 0.0, Y)  # as of a plant at rest
    found = described(tmp_path / "rig.csv", text(U, output, heading=heading), rate=1e3, inputs=["0-0"], outputs=["1-1"])
    assert np.array_equal(signals(found.data), np.column_stack([U, output]))
    assert found.data.input_names == (heading[0],)
    assert f"names of the columns from the first row: {heading.replace(',', ', ')}" in found.notes


def test_such_a_heading_may_stand_beside_names_of_the_rows(tmp_path: Path) -> None:
    content = text(np.arange(SAMPLES), U, Y, heading=",0,1")
    data = described(tmp_path / "rig.csv", content, rate=1e3, inputs=["1-1"], outputs=["2-2"]).data
    assert np.array_equal(signals(data), np.column_stack([U, Y]))


@pytest.mark.parametrize("heading", ["u,y", "# u,y"])
def test_a_first_row_that_counts_the_columns_below_their_names_is_a_sample(tmp_path: Path, heading: str) -> None:
    assert described(tmp_path / "rig.csv", f"{heading}\n0,1\n{text(U, Y)}", rate=1e3).data.samples == SAMPLES + 1


def test_a_first_row_of_whole_numbers_above_others_of_them_is_a_sample(tmp_path: Path) -> None:
    found = described(tmp_path / "rig.csv", "0,1\n" + text(np.sign(U), Y), rate=1e3, inputs=[0], outputs=[1])
    assert found.data.samples == SAMPLES + 1
    assert any(note.startswith("the first row, 0, 1, is taken as a sample") for note in found.notes)


def test_comments_between_the_samples_are_counted(tmp_path: Path) -> None:
    lines = text(U, Y, heading="u,y").splitlines()
    lines[100:102] = [f"# {line}" for line in lines[100:102]]
    content = "\n".join(["# rig 7", lines[0], "# volts", *lines[1:], "# the end"]) + "\n"
    found = described(tmp_path / "rig.csv", content, rate=1e3)
    assert found.data.samples == SAMPLES - 2
    assert any(note.startswith("comments between the samples, left out: 2") for note in found.notes)


# -- columns by number


CHANNELS = text(TIME, U, Y, 2.0 * Y, heading="t [s],Ch 0,Ch 1,Ch 2")


def test_a_number_that_is_the_end_of_another_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        IdentificationError,
        match=r"--inputs 1 may be column 1 \(Ch 0\) or column 2 \(Ch 1\), counted from 0; write 1-1 or 2-2",
    ):
        described(tmp_path / "rig.csv", CHANNELS, inputs=["1"], outputs=["2"])


@pytest.mark.parametrize(("inputs", "outputs"), [("1-1", "3-3"), ("Ch 0", "Ch 2"), ("0=1-1", "2=Ch 2")])
def test_a_range_or_a_whole_name_is_one_column(tmp_path: Path, inputs: str, outputs: str) -> None:
    data = described(tmp_path / "rig.csv", CHANNELS, inputs=[inputs], outputs=[outputs]).data
    assert np.array_equal(signals(data), np.column_stack([U, 2.0 * Y]))


def test_a_number_is_the_column_whose_name_ends_in_it(tmp_path: Path) -> None:
    content = text(TIME, U, Y, heading="t [s],Ch 1,Ch 2")
    data = described(tmp_path / "rig.csv", content, inputs=[1], outputs=[2]).data
    assert (data.input_names, data.output_names) == (("Ch 1",), ("Ch 2",))


# -- the rate of the times


def note_of_rate(found: DescribedData) -> list[str]:
    return [note for note in found.notes if "as given, is used" in note]


@pytest.mark.parametrize("options", [{"rate": 1e3}, {"sample_time": 1e-3}])
def test_a_rate_that_contradicts_the_times_is_used_with_a_note(tmp_path: Path, options: dict[str, float]) -> None:
    found = described(tmp_path / "rig.csv", text(1.009 * TIME, U, Y, heading="t [s],u,y"), **options)
    assert found.data.sample_time == 1e-3
    assert note_of_rate(found) == ["the times show 991.0803 Hz; 1000 Hz, as given, is used"]


def test_a_rate_in_the_file_that_contradicts_its_times_is_used_with_a_note(tmp_path: Path) -> None:
    np.savez(tmp_path / "rig.npz", t=1.001 * TIME, u=U, y=Y, Ts=1e-3)
    found = read(tmp_path / "rig.npz", controller="none").described
    assert found is not None and len(note_of_rate(found)) == 1


def test_times_more_than_a_percent_off_the_rate_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=r"sample_time 0.001 s is given, but the times are 0.00102 s apart"):
        described(tmp_path / "rig.csv", text(1.02 * TIME, U, Y, heading="t [s],u,y"), rate=1e3)


@pytest.mark.parametrize(
    "time",
    [
        (1.0 + 5e-5) * TIME,  # two quartz clocks
        TIME + 4e-5 * np.cos(np.pi * np.arange(SAMPLES)),  # jitter, also of the first and the last time
    ],
)
def test_a_rate_that_the_times_do_not_exclude_needs_no_note(tmp_path: Path, time: np.ndarray) -> None:
    assert not note_of_rate(described(tmp_path / "rig.csv", text(time, U, Y, heading="t [s],u,y"), rate=1e3))


def test_gaps_after_every_other_sample_are_gaps(tmp_path: Path) -> None:
    times = [0.0, 0.001, 0.1, 0.101, 0.2]
    data = described(tmp_path / "rig.csv", text(times, U[:5], Y[:5], heading="t [s],u,y")).data
    assert data.sample_time == pytest.approx(1e-3)
    assert [item.first_step for item in data.experiments] == [0, 100, 200]


# -- structs


def test_structs_of_several_experiments_are_one_question(tmp_path: Path) -> None:
    path = tmp_path / "rig.mat"
    second = {"u": 2.0 * U, "y": 2.0 * Y, "Ts": 2e-3, "InputName": np.array(["coil"], dtype=object)}
    first = {"u": U, "y": Y, "Ts": 1e-3, "InputName": np.array(["drive"], dtype=object)}
    io.savemat(path, {"exp1": first, "exp2": second})
    with pytest.raises(IdentificationError, match=r"sample times of exp1.Ts, exp2.Ts differ.*--variable"):
        read(path)
    data = read(path, variable="exp2", controller="none").data
    assert np.array_equal(signals(data), 2.0 * np.column_stack([U, Y]))
    assert (data.sample_time, data.input_names) == (2e-3, ("coil",))
    io.savemat(path, {"exp1": {"u": U, "y": Y}, "exp2": {"u": U, "y": Y}, "Ts": 1e-3})
    with pytest.raises(UndescribedError, match=r"are inputs.*name one struct with --variable: exp1, exp2"):
        read(path)
    assert read(path, variable="exp1", controller="none").data.samples == SAMPLES


def test_a_sample_time_of_another_struct_is_not_that_of_the_signals(tmp_path: Path) -> None:
    io.savemat(tmp_path / "rig.mat", {"simulation": {"dt": 1e-6}, "rig": {"u": U, "y": Y, "Ts": 1e-3}})
    assert read(tmp_path / "rig.mat", controller="none").data.sample_time == 1e-3


# -- times of a Parquet file, and stamps of a text


@pytest.mark.parametrize("step", [1_000, 20_000])
def test_stamps_of_parquet_keep_their_nanoseconds(tmp_path: Path, step: int) -> None:
    stamps = 1_700_000_000_123_456_789 + step * np.arange(SAMPLES)
    parquet.write_table(pa.table({"t": pa.array(stamps, pa.timestamp("ns")), "u": U, "y": Y}), tmp_path / "rig.pq")
    loop = read(tmp_path / "rig.pq", controller="none")
    assert loop.data.sample_time == pytest.approx(1e-9 * step, rel=1e-12)
    assert loop.described is not None and not any("off" in note for note in loop.described.notes)


@pytest.mark.parametrize("first", [None, 5])
def test_a_missing_stamp_of_parquet_is_a_missing_time(tmp_path: Path, first: int | None) -> None:
    stamps = pa.array([first, None, *range(7, 7 + SAMPLES)], pa.timestamp("ns"))
    values = np.r_[0.0, 0.0, U]
    parquet.write_table(pa.table({"t": stamps, "u": values, "y": values}), tmp_path / "rig.pq")
    with pytest.raises(IdentificationError, match="the times must be two or more finite numbers"):
        read(tmp_path / "rig.pq")


def test_stamps_of_a_text_keep_their_nanoseconds(tmp_path: Path) -> None:
    start = np.datetime64("2024-05-01T12:00:00.000000", "us")
    rows = [f"{start + np.timedelta64(20 * k, 'us')},{U[k]},{Y[k]}" for k in range(SAMPLES)]
    found = described(tmp_path / "rig.csv", "\n".join(["timestamp,u,y", *rows]) + "\n")
    assert found.data.sample_time == pytest.approx(2e-5, rel=1e-12)
    assert found.data.experiments[0].first_step == 0
    assert not any("off" in note for note in found.notes)


# -- sample times beside the signals


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf"])
def test_a_sample_time_of_parquet_that_is_none_is_not_known(tmp_path: Path, value: str) -> None:
    table = pa.table({"u": U, "y": Y}).replace_schema_metadata({"sample_time": value})
    parquet.write_table(table, tmp_path / "rig.pq")
    assert read(tmp_path / "rig.pq", rate=1e3, controller="none").data.sample_time == 1e-3
    with pytest.raises(IdentificationError, match="the sample time is not known"):
        read(tmp_path / "rig.pq")


@pytest.mark.parametrize("scalar", [{"fs": np.inf}, {"Ts": np.inf}, {"fs": 0.0}, {"Ts": np.nan}, {"fs": 1e-320}])
def test_a_sample_time_of_arrays_that_is_none_is_not_known(tmp_path: Path, scalar: dict[str, float]) -> None:
    np.savez(tmp_path / "rig.npz", u=U, y=Y, **scalar)
    assert read(tmp_path / "rig.npz", rate=1e3, controller="none").data.sample_time == 1e-3


@pytest.mark.parametrize("column", ["i", "x"])
def test_a_signal_is_not_its_own_reference(tmp_path: Path, column: str) -> None:
    file = tmp_path / "data.csv"
    file.write_text("time [s],i [A],x [um]\n" + "".join(f"{0.001 * k:.3f},{k % 3},{k % 5}\n" for k in range(50)))
    with pytest.raises(IdentificationError, match=f"column {column} is named in --reference, and in --inputs or"):
        read(file, inputs="i", outputs="x", reference=column, controller="none")
