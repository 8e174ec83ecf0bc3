"""Exported models compute what the workbench's models do: C and FMU are compiled and run, scripts read back."""

from __future__ import annotations

import ctypes
import re
import runpy
import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import io
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.identification import StateSpaceModel
from amb_core.recording.export.fmu import write_fmu
from amb_core.recording.export.model_texts import STEPS, c_texts, identifier, julia_text, python_text, vector_of

STRICT = (
    "gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-O2", "-ffp-contract=off",
)  # fmt: skip
MATRICES = {"A": "a", "B": "b", "C": "c", "D": "d", "K": "k"}


def drawn(inputs: int, outputs: int, order: int, feedthrough: bool = False, **others: Any) -> StateSpaceModel:
    """A random model with an unstable pole, as a bearing has it."""
    random = np.random.default_rng(order)
    basis = np.linalg.qr(random.normal(size=(order, order)))[0]
    poles = np.append(random.uniform(-0.9, 0.9, order - 1), 1.02)
    return StateSpaceModel(
        a=basis @ np.diag(poles) @ basis.T,
        b=random.normal(size=(order, inputs)),
        c=random.normal(scale=1e-4, size=(outputs, order)),
        d=random.normal(scale=1e-5, size=(outputs, inputs)) * feedthrough,
        k=random.normal(size=(order, outputs)),
        innovation_covariance=1e-14 * np.eye(outputs),
        input_offset=random.normal(size=inputs),
        output_offset=random.normal(scale=1e-5, size=outputs),
        initial_state=np.zeros(order),
        sample_time=1.0 / 30_000.0,
        output_names=tuple(f"y_{number}" for number in range(outputs)),
        **{"input_names": tuple(f"i_{number}" for number in range(inputs))} | others,
    )


MODELS = {
    "bearing": drawn(2, 2, 10),
    "machine": drawn(5, 5, 20, feedthrough=True),
    "motor": drawn(1, 1, 1, input_units=("V",), output_units=("rad/s",)),
    "wide": drawn(1, 3, 2, feedthrough=True),
}


@pytest.fixture(params=MODELS)
def model(request: pytest.FixtureRequest) -> StateSpaceModel:
    return MODELS[request.param]


# -- C


def build(folder: Path, model: StateSpaceModel, *options: str, name: str = "plant") -> Path:
    for file, text in c_texts(model, name).items():
        (folder / file).write_text(text)
    sources = [f"{name}.c"] if "-shared" in options else [f"{name}.c", f"{name}_check.c"]
    subprocess.run([*STRICT, *options, "-o", "made", *sources], cwd=folder, check=True)
    return folder / "made"


def test_c_code_compiles_without_a_warning_and_gives_the_same_bits(model: StateSpaceModel, tmp_path: Path) -> None:
    ended = subprocess.run([build(tmp_path, model)], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout
    assert [re.search(r"largest error (\S+)", line)[1] for line in ended.stdout.splitlines()] == ["0", "0"]  # type: ignore[index]


def test_the_self_check_finds_a_wrong_number(tmp_path: Path) -> None:
    model = MODELS["bearing"]
    made = build(tmp_path, model)
    code = tmp_path / "plant.c"
    number = repr(model.c[0, 0].item())
    assert code.read_text().count(number) == 1
    code.write_text(code.read_text().replace(number, repr(model.c[0, 0].item() * (1.0 + 1e-6))))
    subprocess.run([*STRICT, "-o", made, "plant.c", "plant_check.c"], cwd=tmp_path, check=True)
    assert subprocess.run([made], capture_output=True).returncode == 1


def test_the_test_vector_is_the_response_of_the_model(model: StateSpaceModel) -> None:
    vector = vector_of(model)
    state, predictor = np.zeros(model.order), np.zeros(model.order)
    for step in range(STEPS):
        values = vector.inputs[step] - model.input_offset
        around = model.d @ values + model.output_offset
        np.testing.assert_allclose(vector.outputs[step], model.c @ state + around, rtol=0, atol=1e-12)
        np.testing.assert_allclose(vector.predicted[step], model.c @ predictor + around, rtol=0, atol=1e-12)
        state = model.a @ state + model.b @ values
        innovation = vector.measured[step] - vector.predicted[step]
        predictor = model.a @ predictor + model.b @ values + model.k @ innovation
    assert np.abs(vector.outputs - model.output_offset).max() > 1e-5
    assert vector.rounding < 1e-12


def test_c_code_has_no_allocation_and_needs_no_library(tmp_path: Path) -> None:
    library = build(tmp_path, MODELS["bearing"], "-shared", "-fPIC", "-nostdlib")
    needed = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True)
    assert {line.split()[-1] for line in needed.stdout.splitlines() if " U " in line} <= {"memset", "memcpy"}


@pytest.mark.parametrize(
    ("text", "name"),
    [("Model 3", "model_3"), ("3rd", "model_3rd"), ("while", "model_while"), ("Rig-A", "rig_a"), ("軸", "model")],
)
def test_names_of_c_are_made_of_any_text(text: str, name: str) -> None:
    assert identifier(text) == name


def test_texts_of_a_model_do_not_end_a_comment_or_a_text(tmp_path: Path) -> None:
    model = drawn(
        1, 1, 2, source='*/ int x; /* """ \\', method="n\n4", input_names=('a"$b\\*/',), input_units=("*/\n",)
    )
    build(tmp_path, model)
    (tmp_path / "model.py").write_text(python_text(model))
    assert runpy.run_path(str(tmp_path / "model.py"))["input_names"] == ['a"$b\\*/']
    assert '["a\\"\\$b\\\\*/"]' in julia_text(model)


# -- FMU


class Unit:
    """An FMU as an importer uses it: unpacked, described, its library loaded."""

    def __init__(self, path: Path, folder: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            self.files = archive.namelist()
            archive.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.identifier = self.description.find("CoSimulation").get("modelIdentifier")  # type: ignore[union-attr]
        self.library = ctypes.CDLL(str(folder / "binaries" / "linux64" / f"{self.identifier}.so"))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        self.variables = {item.get("name"): item for item in self.description.iter("ScalarVariable")}

    def instance(self, guid: str = "", kind: int = 1) -> Instance:
        guid = guid or str(self.description.get("guid"))
        made = self.library.fmi2Instantiate(b"one", kind, guid.encode(), b"", None, 0, 0)
        return Instance(self, made)


class Instance:
    """An instance of an FMU."""

    def __init__(self, unit: Unit, handle: int | None) -> None:
        self.unit, self.handle = unit, handle

    def call(self, name: str, *arguments: Any) -> int:
        return int(getattr(self.unit.library, name)(ctypes.c_void_p(self.handle), *arguments))

    def start(self, time: float = 0.0) -> None:
        assert (
            self.call("fmi2SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(time), 0, ctypes.c_double(0.0))
            == 0
        )
        assert self.call("fmi2EnterInitializationMode") == self.call("fmi2ExitInitializationMode") == 0

    def references(self, names: tuple[str, ...]) -> Any:
        numbers = [int(self.unit.variables[name].get("valueReference", "-1")) for name in names]
        return (ctypes.c_uint * len(names))(*numbers)

    def set(self, names: tuple[str, ...], values: np.ndarray) -> int:
        return self.call(
            "fmi2SetReal", self.references(names), ctypes.c_size_t(len(names)), (ctypes.c_double * len(names))(*values)
        )

    def get(self, names: tuple[str, ...]) -> list[float]:
        values = (ctypes.c_double * len(names))()
        assert self.call("fmi2GetReal", self.references(names), ctypes.c_size_t(len(names)), values) == 0
        return list(values)

    def step(self, time: float, size: float) -> int:
        return self.call("fmi2DoStep", ctypes.c_double(time), ctypes.c_double(size), 1)


@pytest.fixture
def unit(model: StateSpaceModel, tmp_path: Path) -> Unit:
    write_fmu(model, tmp_path / "plant.fmu")
    return Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")


def test_an_fmu_steps_through_the_test_vector_bit_for_bit(model: StateSpaceModel, unit: Unit) -> None:
    instance, vector = unit.instance(), vector_of(model)
    start = 3.7
    instance.start(start)
    for step, (inputs, outputs) in enumerate(zip(vector.inputs, vector.outputs, strict=True)):
        assert instance.set(model.input_names, inputs) == 0
        assert instance.get(model.output_names) == outputs.tolist()
        assert instance.step(start + step * model.sample_time, model.sample_time) == 0


def test_an_fmu_holds_its_state_between_its_samples(tmp_path: Path) -> None:
    model = MODELS["bearing"]
    write_fmu(model, tmp_path / "plant.fmu")
    unit = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    fine, coarse = unit.instance(), unit.instance()
    for one in (fine, coarse):
        one.start()
        one.set(model.input_names, model.input_offset + 1.0)
    seen = []
    for part in range(40):  # a quarter of a sample each
        assert fine.step(0.25 * part * model.sample_time, 0.25 * model.sample_time) == 0
        seen.append(fine.get(model.output_names)[0])
    assert len(set(seen)) == 11
    assert coarse.step(0.0, 10.0 * model.sample_time) == 0
    assert coarse.get(model.output_names)[0] == seen[-1]


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("part", [1.0, 0.5, 0.1, 3.0, 0.7])
def test_an_fmu_takes_inputs_at_its_samples_and_holds_them_between(
    part: float, feedthrough: bool, tmp_path: Path
) -> None:
    """Communication steps are a part of a sample; the input changes at each of their ends."""
    model = drawn(2, 2, 10, feedthrough)
    write_fmu(model, tmp_path / "plant.fmu")
    instance = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked").instance()
    instance.start()
    points = round(21 / part)
    inputs = model.input_offset + np.random.default_rng(0).normal(size=(points, 2))
    samples = np.arange(int((points - 1) * part + 1e-9) + 1)
    taken = np.floor(samples / part + 1e-9).astype(int)  # number of the input that is set at each sample
    expected, state = [], np.zeros(model.order)
    for values in inputs[taken] - model.input_offset:
        expected.append(model.c @ state + model.d @ values + model.output_offset)
        state = model.a @ state + model.b @ values
    for point, values in enumerate(inputs):
        assert instance.set(model.input_names, values) == 0
        sample = int(point * part + 1e-9)
        np.testing.assert_allclose(instance.get(model.output_names), expected[sample], rtol=0.0, atol=1e-12)
        assert instance.step(point * part * model.sample_time, part * model.sample_time) == 0


@pytest.mark.parametrize("drift", [-5e-4, 5e-4])
def test_an_fmu_takes_the_input_of_a_sample_from_a_tool_whose_time_is_rounded(drift: float, tmp_path: Path) -> None:
    """Tools that add up communication steps of 0.1 ms are off by that part of a sample after some 100 s."""
    model = MODELS["machine"]
    write_fmu(model, tmp_path / "plant.fmu")
    instance, vector = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked").instance(), vector_of(model)
    instance.start()
    times = model.sample_time * np.append(0.0, np.arange(1, STEPS + 1) + drift)
    for step, (inputs, outputs) in enumerate(zip(vector.inputs, vector.outputs, strict=True)):
        assert instance.set(model.input_names, inputs) == 0
        assert instance.get(model.output_names) == outputs.tolist()
        assert instance.step(times[step], times[step + 1] - times[step]) == 0


def test_an_fmu_keeps_the_input_of_its_last_sample_with_its_state(tmp_path: Path) -> None:
    model = MODELS["machine"]
    write_fmu(model, tmp_path / "plant.fmu")
    instance, half = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked").instance(), 0.5 * model.sample_time
    instance.start()
    kept, seen = ctypes.c_void_p(), []
    instance.set(model.input_names, model.input_offset + 1.0)
    instance.step(0.0, half)
    assert instance.call("fmi2GetFMUstate", ctypes.byref(kept)) == 0
    for _ in range(2):
        assert instance.call("fmi2SetFMUstate", kept) == 0
        instance.set(model.input_names, model.input_offset + 2.0)
        instance.step(half, half)
        instance.step(2.0 * half, 2.0 * half)
        seen.append(instance.get(model.output_names))
    assert seen[0] == seen[1]
    assert instance.call("fmi2FreeFMUstate", ctypes.byref(kept)) == 0


def test_an_fmu_returns_to_a_state_that_was_kept_and_to_its_start(tmp_path: Path) -> None:
    model = MODELS["machine"]
    write_fmu(model, tmp_path / "plant.fmu")
    instance = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked").instance()
    instance.start()
    instance.set(model.input_names, model.input_offset + 1.0)
    kept = ctypes.c_void_p()
    instance.step(0.0, 5.0 * model.sample_time)
    assert instance.call("fmi2GetFMUstate", ctypes.byref(kept)) == 0
    then = instance.get(model.output_names)
    instance.step(5.0 * model.sample_time, 5.0 * model.sample_time)
    assert instance.get(model.output_names) != then
    assert instance.call("fmi2SetFMUstate", kept) == 0
    assert instance.get(model.output_names) == then
    assert instance.call("fmi2FreeFMUstate", ctypes.byref(kept)) == 0
    assert kept.value is None
    assert instance.call("fmi2Reset") == 0
    instance.start()
    assert instance.get(model.output_names) == model.output_offset.tolist()
    instance.unit.library.fmi2FreeInstance(ctypes.c_void_p(instance.handle))


def test_an_fmu_refuses_what_is_not_there(tmp_path: Path) -> None:
    model = MODELS["bearing"]
    write_fmu(model, tmp_path / "plant.fmu")
    unit = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    assert unit.instance(guid="{another}").handle is None
    assert unit.instance(kind=0).handle is None  # model exchange
    instance = unit.instance()
    instance.start()
    assert instance.set(model.output_names, np.zeros(2)) == 3  # fmi2Error: outputs cannot be set
    one, value = (ctypes.c_uint * 1)(99), (ctypes.c_double * 1)()
    assert instance.call("fmi2GetReal", one, ctypes.c_size_t(1), value) == 3
    assert instance.step(0.0, -1e-4) == 3
    assert instance.step(0.0, float("nan")) == 3


def test_the_description_of_an_fmu_is_that_of_the_model(model: StateSpaceModel, unit: Unit) -> None:
    root, inputs = unit.description, len(model.input_names)
    assert root.get("fmiVersion") == "2.0"
    assert list(unit.variables) == [*model.input_names, *model.output_names]
    units = [item.find("Real").get("unit") for item in unit.variables.values()]  # type: ignore[union-attr]
    assert units == [*model.input_units, *model.output_units]
    assert {item.get("name") for item in root.iter("Unit")} == set(units)
    starts = [float(item.find("Real").get("start")) for item in list(unit.variables.values())[:inputs]]  # type: ignore
    assert starts == model.input_offset.tolist()
    unknowns = root.findall("ModelStructure/Outputs/Unknown")
    assert [int(item.get("index", "0")) for item in unknowns] == list(range(inputs + 1, inputs + 1 + len(model.c)))
    for item, gains in zip(unknowns, model.d, strict=True):
        assert [int(word) - 1 for word in item.get("dependencies", "").split()] == np.flatnonzero(gains).tolist()
    assert float(root.find("DefaultExperiment").get("stepSize")) == model.sample_time  # type: ignore
    sources = {f"sources/{item.get('name')}" for item in root.iter("File")}
    assert sources | {f"sources/{unit.identifier}.h"} == {name for name in unit.files if name.startswith("sources/")}


FUNCTIONS = """GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment
    EnterInitializationMode ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal
    SetInteger SetBoolean SetString GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate
    DeSerializeFMUstate GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives DoStep CancelStep
    GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus"""
"""What FMI 2.0.4 (sections 2.1 and 4.2) wants of a library for co-simulation, without the prefix fmi2."""


def test_the_library_of_an_fmu_has_every_function_of_the_standard_and_nothing_else(tmp_path: Path) -> None:
    write_fmu(MODELS["bearing"], tmp_path / "plant.fmu")
    unit = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    library = tmp_path / "unpacked" / "binaries" / "linux64" / f"{unit.identifier}.so"
    shown = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True)
    assert {line.split()[-1] for line in shown.stdout.splitlines()} == {f"fmi2{name}" for name in FUNCTIONS.split()}


def test_the_code_of_an_fmu_compiles_without_a_warning(tmp_path: Path) -> None:
    write_fmu(MODELS["machine"], tmp_path / "plant.fmu")
    Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    folder = tmp_path / "unpacked" / "sources"
    subprocess.run([*STRICT, "-c", *(path.name for path in folder.glob("*.c"))], cwd=folder, check=True)


@pytest.mark.parametrize("label", ["plant_check", "ex\udcff", "a\x01"])
def test_an_fmu_of_any_name_loads(label: str, tmp_path: Path) -> None:
    write_fmu(MODELS["bearing"], tmp_path / "plant.fmu", label)
    unit = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    assert unit.instance().handle


def test_the_same_model_gives_the_same_fmu(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_fmu(MODELS["bearing"], tmp_path / name / "plant.fmu")
    assert (tmp_path / "one" / "plant.fmu").read_bytes() == (tmp_path / "two" / "plant.fmu").read_bytes()


# -- MATLAB, Python, Julia


def test_matlab_finds_what_ss_takes(model: StateSpaceModel, tmp_path: Path) -> None:
    model.save(tmp_path / "model.mat")
    content = io.loadmat(tmp_path / "model.mat")
    for name, field in MATRICES.items():
        assert content[name].tobytes() == getattr(model, field).tobytes()
        assert content[name].shape == getattr(model, field).shape
    assert content["Ts"].item() == model.sample_time
    assert [item.item() for item in content["InputName"].ravel()] == list(model.input_names)
    assert [item.item() for item in content["OutputUnit"].ravel()] == list(model.output_units)


def test_the_script_for_python_makes_the_same_system(model: StateSpaceModel, tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text(python_text(model))
    made = runpy.run_path(str(tmp_path / "model.py"))
    for name, field in MATRICES.items():
        assert made[name].tobytes() == getattr(model, field).tobytes()
    assert made["plant"].A.tobytes() == model.a.tobytes()
    assert made["plant"].dt == model.sample_time
    assert made["plant"].input_labels == list(model.input_names)
    assert made["output_offset"].tobytes() == model.output_offset.tobytes()


def test_the_script_for_python_runs_with_names_that_have_dots(tmp_path: Path) -> None:
    model = drawn(3, 1, 2, input_names=("i.x", "i_x", "i.x_"))
    (tmp_path / "model.py").write_text(python_text(model))
    made = runpy.run_path(str(tmp_path / "model.py"))
    assert made["input_names"] == ["i.x", "i_x", "i.x_"]
    assert made["plant"].input_labels == model.to_control().input_labels == ["i_x_", "i_x", "i_x__"]


def test_the_numbers_for_julia_are_read_back_bit_for_bit(model: StateSpaceModel) -> None:
    text = julia_text(model)
    for name, field in MATRICES.items():
        match = re.search(rf"^{name} = reshape\(\[(.*)\], (\d+), (\d+)\)", text, re.MULTILINE)
        assert match
        numbers = np.array([float(word) for word in match[1].split(",")])
        array = numbers.reshape((int(match[2]), int(match[3])), order="F")  # Julia goes column by column
        assert np.ascontiguousarray(array).tobytes() == getattr(model, field).tobytes()
    assert f"Ts = {model.sample_time!r} " in text
    assert text.endswith("plant = ss(A, B, C, D, Ts)\n")


# -- the command


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["model", "export", *arguments])
    return result.exit_code, str(result.exception or "") + result.output


def test_the_command_writes_beside_the_model_and_overwrites_only_if_told(tmp_path: Path) -> None:
    MODELS["bearing"].save(tmp_path / "rotor.json")
    for form in ("--mat", "--c", "--fmu", "--python", "--julia"):
        code, shown = run(str(tmp_path / "rotor.json"), form)
        assert code == 0, shown
        assert "exists already" in run(str(tmp_path / "rotor.json"), form)[1]
        assert run(str(tmp_path / "rotor.json"), form, "--overwrite")[0] == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"rotor.json", "rotor.mat", "rotor_c", "rotor.fmu", "rotor.py", "rotor.jl"}
    assert {path.name for path in (tmp_path / "rotor_c").iterdir()} == {"rotor.h", "rotor.c", "rotor_check.c"}
    assert StateSpaceModel.load(tmp_path / "rotor.mat").a.tobytes() == MODELS["bearing"].a.tobytes()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "give one format: --mat, --c, --fmu, --python, --julia"),
        (("--mat", "--c"), "give one format"),
        (("--fmu", "--out", "plant.zip"), "the file name must end in .fmu"),
    ],
)
def test_wrong_requests_are_named(arguments: tuple[str, ...], text: str, tmp_path: Path) -> None:
    MODELS["bearing"].save(tmp_path / "rotor.json")
    code, shown = run(str(tmp_path / "rotor.json"), *arguments)
    assert code == 1
    assert text in shown


def test_without_a_compiler_an_fmu_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    MODELS["bearing"].save(tmp_path / "rotor.json")
    assert shutil.which("gcc")
    monkeypatch.setenv("PATH", str(tmp_path))
    code, shown = run(str(tmp_path / "rotor.json"), "--fmu")
    assert code == 1
    assert "needs the compiler gcc" in shown
    assert [path.name for path in tmp_path.iterdir()] == ["rotor.json"]
