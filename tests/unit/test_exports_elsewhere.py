"""Exports in the tools that they are for, where these are installed: gcc, clang, Octave, FMPy."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from amb_core.loop.records import LoopRecord
from amb_core.recording.export import RunTelemetry, write_table
from amb_core.recording.export.fmu import write_fmu
from amb_core.recording.export.model_texts import vector_of
from tests.unit.test_bag_export import samples, whole, write_bag
from tests.unit.test_model_export import MATRICES, MODELS, Unit, build

OPTIONS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wconversion", "-O2", "-ffp-contract=off")
needs_clang = pytest.mark.skipif(shutil.which("clang") is None, reason="clang is not installed")
needs_octave = pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
needs_fmpy = pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="FMPy is not installed")
COMPILERS = [pytest.param("gcc"), pytest.param("clang", marks=needs_clang)]


def octave(folder: Path, script: str) -> str:
    """What Octave prints for a script; a failing `assert` of it fails the test."""
    (folder / "check.m").write_text(script)
    ended = subprocess.run(["octave-cli", "--norc", "check.m"], cwd=folder, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def bits(array: np.ndarray) -> str:
    """An array as a text that Octave reads without loss."""
    rows = "; ".join(" ".join(f"hex2num('{number.hex()}')" for number in _bytes(row)) for row in np.atleast_2d(array))
    return f"[{rows}]"


def _bytes(row: np.ndarray) -> list[bytes]:
    return [np.array(value, dtype=">f8").tobytes() for value in row]


# -- C


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", MODELS)
def test_every_compiler_takes_the_code_without_a_warning_and_passes_its_check(
    compiler: str, name: str, tmp_path: Path
) -> None:
    build(tmp_path, MODELS[name])
    sources = ["plant.c", "plant_check.c"]
    subprocess.run([compiler, *OPTIONS, "-o", "checked", *sources], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "checked"], stdout=subprocess.DEVNULL).returncode == 0


@pytest.mark.parametrize("analysis", [["gcc", "-fanalyzer"], pytest.param(["clang", "--analyze"], marks=needs_clang)])
def test_static_analysis_finds_nothing_in_model_and_fmu(analysis: list[str], tmp_path: Path) -> None:
    build(tmp_path, MODELS["machine"])
    write_fmu(MODELS["machine"], tmp_path / "plant.fmu")
    unit = Unit(tmp_path / "plant.fmu", tmp_path / "unpacked")
    for source in [*tmp_path.glob("*.c"), *(tmp_path / "unpacked/sources").glob("*.c")]:
        command = [*analysis, *OPTIONS, "-c", source.name, "-o", str(tmp_path / "analysed")]
        ended = subprocess.run(command, cwd=source.parent, capture_output=True, text=True)
        assert (ended.returncode, ended.stderr) == (0, ""), f"{unit.identifier}, {source.name}"


# -- Octave


@needs_octave
@pytest.mark.parametrize("name", MODELS)
def test_octave_finds_a_model_bit_for_bit(name: str, tmp_path: Path) -> None:
    model = MODELS[name]
    model.save(tmp_path / "model.mat")
    matrices = [f"assert(isequal({matlab}, {bits(getattr(model, field))}));" for matlab, field in MATRICES.items()]
    names = [f"assert(strcmp(InputName{{{number}}}, '{one}'));" for number, one in enumerate(model.input_names, 1)]
    shown = octave(tmp_path, "\n".join(["load('model.mat');", *matrices, *names, "printf('%.17g', Ts)"]))
    assert float(shown) == model.sample_time


@needs_octave
def test_octave_finds_a_recording_bit_for_bit(tmp_path: Path) -> None:
    record: LoopRecord = samples()
    write_table(RunTelemetry(write_bag(tmp_path / "bag", record, whole(1000))), tmp_path / "run.mat")
    octave(
        tmp_path,
        "\n".join(
            [
                "run = load('run.mat');",
                f"assert(isequal(run.x, {bits(record.position[:, 0])}'));",
                f"assert(isequal(run.i_y, {bits(record.current[:, 1])}'));",
                "assert(strcmp(run.names{1}, 'time') && strcmp(run.units{1}, 's'));",
            ]
        ),
    )


# -- FMPy


@needs_fmpy
@pytest.mark.parametrize("name", MODELS)
def test_a_unit_stepped_by_fmpy_has_the_same_bits_and_no_problem(name: str, tmp_path: Path) -> None:
    import fmpy  # type: ignore[import-not-found, unused-ignore]
    from fmpy.fmi2 import FMU2Slave  # type: ignore[import-not-found, unused-ignore]
    from fmpy.validation import validate_fmu  # type: ignore[import-not-found, unused-ignore]

    model, vector = MODELS[name], vector_of(MODELS[name])
    unit = str(tmp_path / "plant.fmu")
    write_fmu(model, Path(unit))
    assert not validate_fmu(unit)  # by the schema of the standard, and by more rules
    description = fmpy.read_model_description(unit)
    number = {one.name: one.valueReference for one in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(unit, str(tmp_path / "unpacked")),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="plant",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    for step, (inputs, outputs) in enumerate(zip(vector.inputs, vector.outputs, strict=True)):
        slave.setReal([number[one] for one in model.input_names], inputs.tolist())
        assert slave.getReal([number[one] for one in model.output_names]) == outputs.tolist()
        slave.doStep(step * model.sample_time, model.sample_time)
    slave.terminate()
    slave.freeInstance()


@needs_fmpy
@pytest.mark.parametrize("name", [name for name, model in MODELS.items() if not model.d.any()])
def test_fmpy_simulates_a_unit_without_feedthrough_to_the_same_bits(name: str, tmp_path: Path) -> None:
    """With feedthrough it records an output before it has set the input of that time, as masters of FMI 2.0 may."""
    from fmpy import simulate_fmu  # type: ignore[import-not-found, unused-ignore]

    model, vector = MODELS[name], vector_of(MODELS[name])
    write_fmu(model, tmp_path / "plant.fmu")
    period = model.sample_time
    times = np.arange(len(vector.inputs)) * period
    kinds = [(one, float) for one in ("time", *model.input_names)]
    signals = np.array([tuple(row) for row in np.column_stack([times, vector.inputs])], dtype=kinds)
    timing = {"stop_time": times[-1], "output_interval": period, "step_size": period}
    simulated = simulate_fmu(str(tmp_path / "plant.fmu"), input=signals, **timing)
    assert np.column_stack([simulated[one] for one in model.output_names]).tobytes() == vector.outputs.tobytes()
