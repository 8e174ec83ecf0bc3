"""Data in files come back bit for bit; foreign files are read where they tell enough, and refused in one line."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import io

from amb_core.data.analysis import read
from amb_core.data.experiments import (
    Experiment,
    IdentificationData,
    detrend,
    merge,
    write_data,
)
from amb_core.data.experiments.proposal import UndescribedError
from amb_core.ground.errors import AmbError, IdentificationError

ENDINGS = ["csv", "npz", "mat"]
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8)
NAMES = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S")), min_size=1, max_size=8)


def identical(one: IdentificationData, other: IdentificationData) -> bool:
    same = all(
        getattr(one, item.name) == getattr(other, item.name)
        for item in fields(IdentificationData)
        if item.name != "experiments"
    )
    return same and all(
        _same(getattr(mine, item.name), getattr(theirs, item.name))
        for mine, theirs in zip(one.experiments, other.experiments, strict=True)
        for item in fields(Experiment)
    )


def _same(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.shape == other.shape and np.array_equal(one, other, equal_nan=True)
    return type(one) is type(other) and one == other


@st.composite
def datasets(draw: st.DrawFn) -> IdentificationData:
    m, p = draw(st.integers(1, 3)), draw(st.integers(1, 3))

    def signals(rows: int, columns: int) -> st.SearchStrategy[np.ndarray]:
        return arrays(np.float64, (rows, columns), elements=VALUES)

    experiments = []
    for _ in range(draw(st.integers(1, 3))):
        steps = draw(st.integers(1, 4))
        experiments.append(
            Experiment(
                draw(signals(steps, m)),
                draw(signals(steps, p)),
                draw(st.none() | signals(steps, p)),
                draw(st.integers(0, 2**40)),
                draw(TEXTS),
                *(draw(signals(2, columns)) for columns in (m, p, p)),
            )
        )
    names = draw(st.lists(NAMES, min_size=m + p, max_size=m + p, unique=True))
    units = draw(st.lists(NAMES | st.just(""), min_size=m + p, max_size=m + p))
    sample_time = draw(st.floats(1e-9, 1e3))
    clearance = draw(st.dictionaries(st.sampled_from(names[m:]), st.floats(1e-6, 1e-2)))
    return IdentificationData(
        tuple(experiments),
        sample_time,
        names[:m],
        names[m:],
        units[:m],
        units[m:],
        clearance=clearance,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_written_is_read_bit_for_bit(ending: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("data") / f"data.{ending}"

    @given(data=datasets())
    @settings(max_examples=12, deadline=None)
    def round_trip(data: IdentificationData) -> None:
        write_data(data, path)
        assert identical(read(path).data, data)

    round_trip()


def small(steps: int = 6, reference: bool = True) -> IdentificationData:
    signals = np.random.default_rng(0).normal(size=(3, steps, 2))
    return IdentificationData.from_arrays(
        *signals[:2],
        1e-4,
        reference=signals[2] if reference else None,
        input_names=["i_x", "i_y"],
        output_names=["x", "y"],
        input_units=["A", "A"],
        output_units=["m", "m"],
    )


@pytest.mark.parametrize("ending", ENDINGS)
def test_data_without_a_known_clearance_are_written_as_in_version_0_1(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"data.{ending}"
    write_data(small(), path)
    assert b"earance" not in path.read_bytes()
    assert read(path).data.clearance == {}


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_clearance_that_a_user_gives_replaces_that_of_the_file(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"data.{ending}"
    write_data(replace(small(), clearance={"x": 2.5e-4}), path)
    assert read(path, clearance="100um").data.clearance == {"x": 1e-4, "y": 1e-4}


def test_a_clearance_in_a_unit_of_no_length_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    write_data(replace(small(), clearance={"x": 2.5e-4}), path)
    path.write_text(path.read_text().replace('"clearance_unit": "m"', '"clearance_unit": "A"'))
    with pytest.raises(IdentificationError, match=r"has 2 clearances in A; allowed: one for each of x, y, in m, cm"):
        read(path)


def test_a_csv_file_has_names_units_and_times(tmp_path: Path) -> None:
    write_data(merge([small(), small(reference=False)]), tmp_path / "data.csv")
    comment, header, first, *rest = (tmp_path / "data.csv").read_text().splitlines()
    assert comment.startswith("# amb_core {")
    assert header == "experiment,time [s],i_x [A],i_y [A],x [m],y [m],r_x [m],r_y [m]"
    assert first.startswith("0,0.0,0.12573022")
    assert rest[-1].endswith(",nan,nan")


def test_a_mat_file_has_what_matlab_needs_for_its_own_data(tmp_path: Path) -> None:
    write_data(merge([small(), small(9, reference=False)]), tmp_path / "data.mat")
    content = io.loadmat(tmp_path / "data.mat", simplify_cells=True)
    assert [item.shape for item in content["u"]] == [(6, 2), (9, 2)]
    assert [item.shape for item in content["y"]] == [(6, 2), (9, 2)]
    assert content["Ts"] == 1e-4
    assert list(content["InputName"]) == ["i_x", "i_y"]
    assert list(content["OutputUnit"]) == ["m", "m"]


# -- files of others


def write_text(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_table_with_names_units_and_times_is_read(tmp_path: Path) -> None:
    rows = [f"{0.2 + 0.1 * k:.4f};{k};{-k};{2 * k}" for k in range(5)]
    path = write_text(tmp_path / "rig.csv", "\n".join(["# rig 7", "t [ms];i [A];speed;z [um]", *rows]))
    data = read(path, inputs=["i"], outputs=["z"]).data
    assert data.sample_time == pytest.approx(1e-4)
    assert (data.input_names, data.input_units, data.output_units) == (("i",), ("A",), ("m",))
    assert data.experiments[0].first_step == 2
    assert data.experiments[0].outputs[:, 0].tolist() == pytest.approx([0.0, 2e-6, 4e-6, 6e-6, 8e-6])


def test_a_table_of_a_spreadsheet_begins_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("\ufeffi,x\n1,2\n3,4\n", encoding="utf-8")
    data = read(tmp_path / "table.csv", inputs=["i"], outputs=["x"], sample_time=0.1).data
    assert data.experiments[0].inputs.tolist() == [[1.0], [3.0]]


@pytest.mark.parametrize("mark", [";", "\t", " "])
@pytest.mark.parametrize("columns", [2, 3])
@pytest.mark.parametrize("whole", [0, 80])
def test_decimal_commas_are_found_whatever_separates_a_few_columns(
    tmp_path: Path, mark: str, columns: int, whole: int
) -> None:
    """An input is of whole numbers, and in the second half of the cases so are all of the last rows."""
    rng = np.random.default_rng(3)
    values = np.column_stack([rng.normal(size=200), rng.choice([-1.0, 1.0], 200), rng.normal(size=200)])
    values = np.float64([f"{value:.9g}" for value in values.ravel()]).reshape(values.shape)[:, -columns:]
    values[len(values) - whole :] = np.round(values[len(values) - whole :])
    rows = [mark.join(f"{value:.9g}" for value in row).replace(".", ",") for row in values]
    heading = mark.join(["r", "u", "y"][-columns:])
    path = write_text(tmp_path / "de.csv", "\n".join([heading, *rows]) + "\n")
    loop = read(path, rate=1e3, controller="none")
    assert np.array_equal(loop.data.experiments[0].inputs, values[:, -2:-1])
    assert np.array_equal(loop.data.experiments[0].outputs, values[:, -1:])
    assert loop.described is not None and "decimal commas" in loop.described.notes


@pytest.mark.parametrize("mark", [",", " "])
def test_names_in_a_comment_above_the_numbers_are_those_of_the_columns(tmp_path: Path, mark: str) -> None:
    """As `numpy.savetxt` writes a header by default."""
    numbers = np.random.default_rng(4).normal(size=(40, 2))
    header = mark.join(["speed", "u"])
    np.savetxt(tmp_path / "np.csv", numbers, delimiter=mark, header=f"measured on Monday{mark}\n{header}")
    loop = read(tmp_path / "np.csv", rate=1e3, controller="none", inputs=["u"], outputs=["speed"])
    assert np.array_equal(loop.data.experiments[0].inputs[:, 0], numbers[:, 1])
    assert loop.described is not None
    assert "names of the columns from the comment above them" in loop.described.notes


def rows_of_r(names: list[str]) -> str:
    """Lines with names of rows, under a heading without one, as `write.table(sep=",")` of R."""
    lines = ['"i_x","i_y","x","y"', *(f'"{name}",{k % 3},{k % 5},{k % 7},{k % 4}' for k, name in enumerate(names))]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("names", [[str(k) for k in range(1, 31)], [str(k) for k in range(30)], ["row"] * 30])
def test_names_above_all_columns_but_the_first_are_those_of_these_columns(tmp_path: Path, names: list[str]) -> None:
    loop = read(write_text(tmp_path / "r.csv", rows_of_r(names)), rate=1e4, controller="none")
    (item,) = loop.data.experiments
    assert item.inputs[4].tolist() == [1.0, 4.0]
    assert item.outputs[4].tolist() == [4.0, 0.0]
    assert loop.described is not None
    assert "the first column has no name and those of the rows: left out" in loop.described.notes


def test_units_below_such_names_are_those_of_the_same_columns(tmp_path: Path) -> None:
    text = rows_of_r([str(k) for k in range(1, 31)]).replace("\n", "\nA,mA,um,mm\n", 1)
    item = read(write_text(tmp_path / "r.csv", text), rate=1e4, controller="none").data.experiments[0]
    assert item.signals[4].tolist() == pytest.approx([1.0, 4e-3, 4e-6, 0.0])


def test_names_above_all_columns_but_one_are_refused_where_that_may_be_any(tmp_path: Path) -> None:
    path = write_text(tmp_path / "lab.csv", rows_of_r([f"{0.5 * k}" for k in range(30)]))
    for columns in ({}, {"inputs": "i_x", "outputs": "x"}):
        with pytest.raises(IdentificationError, match=r"4 names stand above 5 columns.*a name above every column"):
            read(path, rate=1e4, **columns)


def test_missing_times_split_a_table(tmp_path: Path) -> None:
    times = [0.0, 0.001, 0.002, 0.005, 0.006, 0.010]
    path = write_text(tmp_path / "rig.csv", "\n".join(["time,u,y", *(f"{time},1,2" for time in times)]))
    data = read(path, inputs=["u"], outputs=["y"]).data
    assert [(item.first_step, item.stop) for item in data.experiments] == [(0, 3), (5, 7), (10, 11)]
    assert [gap.steps for gap in data.gaps] == [2, 3]


TABLE = "time [s],u,y\n0,1,2\n0.1,2,3\n0.2,3,4\n0.3,3,5\n"
COLUMNS = {"inputs": ["u"], "outputs": ["y"]}


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (
            TABLE.replace(",u,", ",v,"),
            {},
            "which of the 3 columns are inputs and which outputs is not known.*time, v, y",
        ),
        (TABLE, {"inputs": ["v"], "outputs": ["y"]}, "--inputs: there must be one column 'v'; there are time, u, y"),
        (TABLE, COLUMNS | {"sample_time": 1e-4}, "sample_time 0.0001 s is given, but the times are 0.1 s apart"),
        (TABLE.replace("0.2,", "0.15,"), COLUMNS, "irregular sample time: between samples"),
        (TABLE.replace("0.2,", "0.1,"), COLUMNS, "times must rise; sample 2 is at 0.1 s, the one before at 0.1 s"),
        (TABLE.replace("0.2,", "nan,"), COLUMNS, "the times must be two or more finite numbers"),
        (TABLE.replace("[s]", "[h]"), COLUMNS, "times are in h; allowed: s, ms, us"),
        (TABLE.replace("time [s]", "step"), COLUMNS, "the sample time is not known; give sample_time in s"),
        ("0,1,2\n0.1,2,3\n", COLUMNS, "there must be one column 'u'; there are column 0, column 1, column 2"),
        (TABLE + "0.4,oops,3\n", COLUMNS, "could not convert string 'oops'"),
        (TABLE + "0.4,3\n0.5,3,4\n", COLUMNS, "damaged"),
        ("u,y\n", COLUMNS, "there are no samples"),
        ("", COLUMNS, "is empty"),
        ("# amb_core {}\nu,y\n1,2\n", {}, "damaged"),
        ("# amb_core {\nu,y\n1,2\n", {}, "damaged"),
    ],
)
def test_tables_that_do_not_tell_enough_are_refused_in_one_line(
    tmp_path: Path, text: str, options: dict[str, object], message: str
) -> None:
    path = write_text(tmp_path / "rig.csv", text)
    with pytest.raises(IdentificationError, match=message) as refusal:
        read(path, **options)
    assert str(refusal.value).startswith(f"data {path}: ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("ending", "save"),
    [
        ("mat", lambda path, **content: io.savemat(path, content)),
        ("npz", lambda path, **content: np.savez(path, **content)),
    ],
)
def test_one_matrix_whose_columns_are_signals_is_read(tmp_path: Path, ending: str, save: Callable[..., None]) -> None:
    matrix = np.arange(20.0).reshape(5, 4)
    path = tmp_path / f"arm.{ending}"
    save(path, arm=matrix, note=np.zeros((2, 2)))
    data = read(path, variable="arm", inputs=[0, 1], outputs=[2, 3], sample_time=0.1).data
    assert np.array_equal(data.experiments[0].inputs, matrix[:, :2])
    assert np.array_equal(data.experiments[0].outputs, matrix[:, 2:])
    assert data.output_names == ("y1", "y2")
    columns = {"inputs": [0], "outputs": [1]}
    for options, message in (
        ({}, r"which of the 4 columns are inputs.*\(left out, of another length: note \(2, 2\)\)"),
        ({"variable": "leg"}, "has no matrix leg"),
        ({"variable": "arm"}, "which of the 4 columns are inputs and which outputs is not known"),
        ({"variable": "arm", "inputs": [0], "outputs": [4]}, "there is no column 4; allowed: 0 to 3"),
        ({"variable": "arm", **columns}, "the sample time is not known; give sample_time in s"),
        ({"variable": "arm", **columns, "sample_time": -1.0}, "'sample_time' = -1.0 is not allowed"),
    ):
        with pytest.raises(IdentificationError, match=message):
            read(path, **options)  # type: ignore[arg-type]


def test_matrices_u_and_y_are_read_from_a_mat_file(tmp_path: Path) -> None:
    path = tmp_path / "motor.mat"
    io.savemat(path, {"u": np.zeros((5, 1)), "y": np.ones((5, 2))})
    data = read(path, sample_time=0.1).data
    assert (data.input_names, data.output_names, data.samples) == (("u",), ("y1", "y2"), 5)
    io.savemat(path, {"u": np.zeros((5, 1)), "y": np.ones((5, 2)), "Ts": 0.2})
    assert read(path).data.sample_time == 0.2
    with pytest.raises(IdentificationError, match=r"sample_time 0.1 s is given, but the file has Ts = 0.2 s"):
        read(path, sample_time=0.1)
    io.savemat(path, {"u": np.zeros((5, 1)), "y": np.ones((4, 2)), "Ts": 0.2})
    with pytest.raises(IdentificationError, match="the lengths differ"):
        read(path)


def cells(*matrices: np.ndarray) -> np.ndarray:
    array = np.empty((1, len(matrices)), dtype=object)
    array[0, :] = matrices
    return array


def test_cells_of_experiments_are_read_from_a_mat_file(tmp_path: Path) -> None:
    path = tmp_path / "motor.mat"
    io.savemat(path, {"u": cells(np.zeros((5, 1)), np.zeros((4, 1))), "y": cells(np.ones((5, 1)), np.ones((4, 1)))})
    data = read(path, sample_time=0.1).data
    assert [item.steps for item in data.experiments] == [5, 4]
    assert data.foreign
    assert not data.gaps


U, Y = np.random.default_rng(5).normal(size=(2, 60, 2))
CELLS = {"u": cells(U[:35], U[35:]), "y": cells(Y[:35], Y[35:])}


def saved(path: Path, **variables: object) -> Path:
    io.savemat(path, variables)
    return path


def test_options_hold_for_cells_of_experiments(tmp_path: Path) -> None:
    path = saved(tmp_path / "rig.mat", **CELLS, Ts=1e-4)
    scaled = read(path, units="um,mA", controller="none").data
    assert (scaled.input_units, scaled.output_units) == (("A", "A"), ("m", "m"))
    assert scaled.experiments[1].inputs == pytest.approx(1e-3 * U[35:])
    assert scaled.experiments[1].outputs == pytest.approx(1e-6 * Y[35:])
    named = read(path, inputs=["u[1]"], outputs=["x=y[0]"], controller="none").data
    assert np.array_equal(named.experiments[1].inputs, U[35:, 1:])
    assert named.output_names == ("x",)
    other = saved(tmp_path / "other.mat", drive=CELLS["u"], probe=CELLS["y"], Ts=1e-4)
    assert len(read(other, inputs=["drive"], outputs=["probe"], controller="none").data.experiments) == 2


def test_units_beside_cells_are_those_of_the_signals(tmp_path: Path) -> None:
    units = {"InputUnit": cells("A", "A"), "OutputUnit": cells("um", "um")}
    loop = read(saved(tmp_path / "rig.mat", **CELLS, **units, Ts=1e-4), controller="none")
    assert loop.data.output_units == ("m", "m")
    assert loop.data.experiments[0].outputs == pytest.approx(1e-6 * Y[:35])
    assert loop.described is not None
    assert [row.samples for row in loop.described.rows] == [60] * 4


def test_missing_samples_of_cells_are_left_out_where_that_is_asked_for(tmp_path: Path) -> None:
    u = U.copy()
    u[60 - 3] = np.nan
    path = saved(tmp_path / "rig.mat", u=cells(u[:35], u[35:]), y=CELLS["y"], Ts=1e-4)
    with pytest.raises(IdentificationError, match=r"experiment 1: 1 of 25 rows lack a number.*--repair split"):
        read(path, controller="none")
    assert [item.steps for item in read(path, repair="split", controller="none").data.experiments] == [35, 22]


@pytest.mark.parametrize(
    "clock", [{"Ts": cells(1e-4, 1e-4)}, {"fs": 1e4}, {"t": cells(1e-4 * np.arange(35), 1e-4 * np.arange(25))}]
)
def test_the_sample_time_of_cells_may_be_a_cell_a_rate_or_times(tmp_path: Path, clock: dict[str, object]) -> None:
    path = saved(tmp_path / "rig.mat", **CELLS, **clock)
    assert read(path, controller="none").data.sample_time == pytest.approx(1e-4)
    with pytest.raises(IdentificationError, match="sample_time 5e-05 s is given, but"):
        read(path, rate=2e4, controller="none")


def test_cells_of_different_numbers_or_sample_times_are_no_experiments(tmp_path: Path) -> None:
    path = saved(tmp_path / "rig.mat", u=CELLS["u"], y=cells(Y[:35], Y[35:], Y[35:]), Ts=1e-4)
    with pytest.raises(
        IdentificationError, match="u has 2 experiments, y has 3 experiments; the numbers must be equal"
    ):
        read(path, controller="none")
    with pytest.raises(IdentificationError, match="only data of one sample time"):
        read(saved(path, **CELLS, Ts=cells(1e-4, 2e-4)), controller="none")


def test_cells_beside_plain_signals_are_no_experiments(tmp_path: Path) -> None:
    loop = read(saved(tmp_path / "rig.mat", u=U, y=Y, Ts=1e-4, notes=cells(np.ones(3), np.ones(3))), controller="none")
    assert [item.steps for item in loop.data.experiments] == [60]


@pytest.mark.parametrize("ending", ENDINGS)
def test_missing_samples_of_what_was_written_are_left_out_where_that_is_asked_for(tmp_path: Path, ending: str) -> None:
    data = IdentificationData.from_arrays(np.where(np.arange(60)[:, None] == 40, np.nan, U), Y, 1e-4)
    write_data(data, tmp_path / f"data.{ending}")
    assert [item.steps for item in read(tmp_path / f"data.{ending}", repair="split").data.experiments] == [40, 19]


@pytest.mark.parametrize(
    ("ending", "save"), [("mat", lambda path, **content: io.savemat(path, content)), ("npz", np.savez)]
)
def test_arrays_of_another_length_are_left_out_and_named(
    tmp_path: Path, ending: str, save: Callable[..., None]
) -> None:
    path = tmp_path / f"rig.{ending}"
    save(path, u=U, y=Y, Ts=1e-4, gains=np.array([2e4, 38.0]), spectrum=np.ones(31))
    for options in ({}, {"inputs": ["u"], "outputs": ["y"]}):
        loop = read(path, controller="none", **options)
        assert np.array_equal(loop.data.experiments[0].inputs, U)
        assert loop.described is not None
        assert any("another length: gains" in note and "spectrum" in note for note in loop.described.notes)
    save(path, drive=U, probe=Y, Ts=1e-4, history=np.ones(900))
    options = {"inputs": ["drive[0]"], "outputs": ["probe[1]"]}
    assert read(path, controller="none", **options).data.samples == 60
    with pytest.raises(
        IdentificationError, match=r"the named signals have different lengths: drive \(60, 2\), history"
    ):
        read(path, inputs=["drive"], outputs=["history"])


def test_arrays_named_as_those_of_this_workbench_are_arrays_of_others(tmp_path: Path) -> None:
    path = tmp_path / "own.npz"
    np.savez(path, inputs_0=U, outputs_0=Y, sample_time=1e-4)
    with pytest.raises(UndescribedError, match=r"give inputs and outputs .*there are inputs_0\[0\], inputs_0\[1\]"):
        read(path)
    data = read(path, inputs=["inputs_0"], outputs=["outputs_0"]).data
    assert np.array_equal(data.experiments[0].outputs, Y)


def test_names_and_units_of_matlabs_iddata_are_those_of_the_signals(tmp_path: Path) -> None:
    path = tmp_path / "rig.mat"
    named = {"InputName": ["cur_x", "cur_y"], "OutputName": ["pos_x", "pos_y"]}
    units = {"InputUnit": ["mA", "mA"], "OutputUnit": ["um", "um"]}
    texts = {name: np.array(value, dtype=object) for name, value in (named | units).items()}
    io.savemat(path, {"u": np.ones((9, 2)), "y": np.ones((9, 2)), "r": np.ones((9, 2)), "Ts": 1e-4, **texts})
    data = read(path).data
    assert (data.input_names, data.output_names) == (("cur_x", "cur_y"), ("pos_x", "pos_y"))
    assert (data.input_units, data.output_units) == (("A", "A"), ("m", "m"))
    assert data.experiments[0].inputs[0].tolist() == [1e-3, 1e-3]
    assert data.experiments[0].outputs[0].tolist() == [1e-6, 1e-6]
    assert data.experiments[0].reference is not None


LAB = "t [s],cur_x_A,cur_y_A,pos_x_m,pos_y_m,ref_x_m,temperature\n" + "\n".join(
    f"{1e-4 * k:g},{k % 3},{k % 2},{k % 5},{k % 7},0,20" for k in range(40)
)


def test_signals_get_the_names_and_units_that_a_description_gives(tmp_path: Path) -> None:
    path = write_text(tmp_path / "lab.csv", LAB)
    loop = read(path, inputs="i_x=cur_x_A,i_y=cur_y_A", outputs="x=pos_x_m,y=pos_y_m", controller="none")
    assert (loop.data.input_names, loop.data.output_names) == (("i_x", "i_y"), ("x", "y"))
    assert (loop.data.input_units, loop.data.output_units) == (("A", "A"), ("m", "m"))
    assert loop.described is not None
    assert "columns not used: ref_x_m, temperature; if one is the setpoint: --reference, one for each output" in (
        loop.described.notes
    )
    scaled = read(path, inputs="i_x=cur_x_A", outputs="x=pos_x_m", units="x=um", controller="none").data
    assert scaled.experiments[0].outputs.max() == pytest.approx(4e-6)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("mV,um", "--units mV may be that of inputs or outputs; name the signals that have it, as in --units u=mV"),
        ("um,N", "--units N may be that of inputs or outputs.*--units u=N"),
        (
            "um,mm",
            "two units for all lengths, um and mm; name the signals that have one of them, as in --units y=mm",
        ),
        ("A,mA", "two units for all currents, A and mA"),
        ("s,ms", "two units for all times, s and ms"),
        ("y=um,y=mm", "--units gives y two units, um and mm; give it one"),
    ],
)
def test_units_that_would_be_ignored_are_refused(tmp_path: Path, units: str, message: str) -> None:
    path = write_text(tmp_path / "rig.csv", TABLE)
    with pytest.raises(IdentificationError, match=message):
        read(path, units=units)


def test_units_of_named_signals_and_of_all_others_go_together(tmp_path: Path) -> None:
    data = read(write_text(tmp_path / "rig.csv", TABLE), units="u=mV,um,um", controller="none").data
    assert (data.input_units, data.output_units) == (("V",), ("m",))
    assert data.experiments[0].signals[0].tolist() == pytest.approx([1e-3, 2e-6])


def test_an_axis_in_brackets_is_no_unit(tmp_path: Path) -> None:
    rows = "\n".join(f"{k % 3},{k % 2},{k % 5},{k}" for k in range(40))
    path = write_text(tmp_path / "lab.csv", f"coil[x] [mA],coil [y],position[x] (um),[y]\n{rows}\n")
    data = read(path, inputs=["coil[x]", "coil [y]"], outputs=["position[x]", "[y]"], rate=1e4, controller="none").data
    assert (data.input_names, data.output_names) == (("coil[x]", "coil [y]"), ("position[x]", "[y]"))
    assert (data.input_units, data.output_units) == (("A", ""), ("m", ""))


def test_a_description_is_proposed_never_assumed(tmp_path: Path) -> None:
    path = write_text(tmp_path / "lab.csv", LAB)
    with pytest.raises(
        UndescribedError, match="perhaps --inputs i_x=cur_x_A,i_y=cur_y_A --outputs x=pos_x_m"
    ) as refusal:
        read(path)
    assert refusal.value.proposal is not None
    refusal.value.proposal.save(tmp_path / "lab.yaml")
    data = read(path, tmp_path / "lab.yaml").data
    assert (data.input_names, data.output_names, data.input_units) == (("i_x", "i_y"), ("x", "y"), ("A", "A"))


def test_proposed_options_stand_as_a_shell_reads_them(tmp_path: Path) -> None:
    rows = "\n".join(f"{k % 3},{k % 2},{k % 5},{k}" for k in range(40))
    path = write_text(tmp_path / "lab.csv", f"cur x [A],cur y [A],gap [x] [m],gap [y] [m]\n{rows}\n")
    with pytest.raises(UndescribedError) as refusal:
        read(path)
    words = shlex.split(str(refusal.value).partition("perhaps ")[2])
    assert words[:2] == ["--inputs", "i_x=cur x,i_y=cur y"] and words[2:4] == ["--outputs", "x=gap [x],y=gap [y]"]


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_and_missing_files_are_refused_in_one_line(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"data.{ending}"
    write_data(detrend(small(2_000)), path)
    whole = path.read_bytes()
    for length in (0, 40, len(whole) // 2):
        path.write_bytes(whole[:length])
        with pytest.raises(IdentificationError, match=f"data {path}: ") as refusal:
            read(path)
        assert "\n" not in str(refusal.value)
    with pytest.raises(IdentificationError, match="cannot be read: No such file"):
        read(tmp_path / f"missing.{ending}")
    with pytest.raises(IdentificationError, match="cannot be written: No such file"):
        write_data(small(), tmp_path / "missing" / f"data.{ending}")


def test_a_damaged_mat_file_of_version_7_3_says_how_to_write_another(tmp_path: Path) -> None:
    path = tmp_path / "new.mat"
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(header + b"\x89HDF" + bytes(400))
    with pytest.raises(
        IdentificationError, match=r"version 7\.3 that is damaged.*; write it with save\(\.\.\., '-v7'\)"
    ):
        read(path)


def test_unknown_endings_and_options_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=r"must end in \.csv, \.npz, \.mat"):
        write_data(small(), tmp_path / "data.txt")
    write_data(small(), tmp_path / "data.mat")
    with pytest.raises(IdentificationError, match="run and steps are not allowed; they are for bags"):
        read(tmp_path / "data.mat", run=1)
    with pytest.raises(AmbError, match="no such file or folder"):
        read(tmp_path / "data.bag")


@pytest.mark.skipif("AMB_CD_PLAYER" not in os.environ, reason="AMB_CD_PLAYER does not name the CD player's file")
def test_the_cd_players_arm_is_read() -> None:
    """The benchmark CD player's arm of the DaISy collection: two inputs, two outputs, 2048 samples."""
    data = read(os.environ["AMB_CD_PLAYER"], inputs=[0, 1], outputs=[2, 3], sample_time=1.0).data
    assert (data.samples, len(data.input_names), len(data.output_names)) == (2048, 2, 2)
