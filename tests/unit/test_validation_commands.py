"""`amb validate` and `amb compare`: a page or a table to the terminal, numbers and figures to files, exit codes."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from amb_bringup.cli import app
from amb_core.data.analysis import read
from amb_core.data.experiments import IdentificationData, write_data
from amb_core.ground.errors import AmbError, IdentificationError
from amb_core.identification import StateSpaceModel, ssarx
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter
from tests.bag_messages import PARAMETERS, TELEMETRY, definition, telemetry


def amb(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)


def write_bag(folder: Path, record: LoopRecord, controller: ControllerParameters | None, plant: bool = False) -> Path:
    with BagWriter(folder) as bag:
        for topic, kind in (("/amb/telemetry", TELEMETRY), ("/parameter_events", PARAMETERS)):
            bag.add_topic(topic, kind, definition(kind))
        if controller is not None:
            bag.write_parameters("/parameter_events", "/amb/pd_controller", controller.model_dump(), 0)
        if plant:
            bag.write_parameters("/parameter_events", "/amb/simulator", {"rotor.gravity": 9.0}, 0)
        for first in range(record.first_step, record.first_step + record.steps, 100):
            steps = min(100, record.first_step + record.steps - first)
            bag.write("/amb/telemetry", telemetry(record.window(first, steps)), first)
    return folder


@pytest.fixture(scope="module")
def record(bearing) -> LoopRecord:
    return bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)


@pytest.fixture(scope="module")
def folder(record: LoopRecord, bearing, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag, the same data without what is known of the loop, a good model, a poor one, and one of another rate."""
    folder = tmp_path_factory.mktemp("validation")
    write_bag(folder / "bag", record, ControllerParameters())
    write_data(IdentificationData.from_record(record), folder / "data.npz")
    good = ssarx(record.current, record.position, record.sample_time, 6, source="bag")
    good.save(folder / "good.json")
    replace(good, b=0.7 * good.b).save(folder / "poor.json")
    replace(good, sample_time=2e-4).save(folder / "slow.json")
    return folder


def test_validate_prints_a_page_and_writes_the_numbers(folder: Path, tmp_path: Path) -> None:
    result = amb(
        "validate", folder / "good.json", folder / "bag", "--horizon", 3, "--horizon", 40, "--results",
        tmp_path / "summary.json",
    )  # fmt: skip
    assert result.exit_code == 0
    for text in ("CLOSED LOOP  stable", "3 steps (0.3 ms)", "40 steps (4 ms)", "VERDICT      validated"):
        assert text in result.stdout
    assert json.loads((tmp_path / "summary.json").read_text())["validated"] is True


@pytest.mark.slow
def test_validate_draws_response_prediction_bode_diagram_and_residuals(folder: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert amb("validate", folder / "good.json", folder / "bag", "--figures", tmp_path).exit_code == 0
    names = {"response", "prediction", "bode", "residuals"}
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {f"{name}.{ending}" for name in names for ending in ("png", "html")} | {"plotly.min.js", ".amb"}


def test_a_model_that_is_not_validated_has_an_exit_code_of_its_own(folder: Path) -> None:
    result = amb("validate", folder / "poor.json", folder / "bag")
    assert result.exit_code == 3
    assert "VERDICT      NOT validated" in result.stdout


def test_data_without_the_controller_are_judged_without_the_loop(folder: Path) -> None:
    result = amb("validate", folder / "good.json", folder / "data.npz")
    assert result.exit_code == 0
    assert "CLOSED LOOP  not checked" in result.stdout and "controller is not known" in result.stdout
    assert "the closed loop of the models is not validated" in result.output


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("good.json", "nowhere"), "nowhere"),
        (("none.json", "bag"), "none.json"),
        (("slow.json", "bag"), "sample time"),
        (("good.json", "bag", "--horizon", "5000"), "horizons from 1 to 5000 steps are not allowed"),
        (("good.json", "bag", "--steps", "120"), "horizons|too few"),
        (("good.json", "data.npz", "--run", "1"), "run and steps are not allowed"),
        (("good.json", "bag", "--results", "numbers.txt"), "numbers.txt: the file name must end in .json"),
    ],
)
def test_what_cannot_be_judged_is_an_error_of_one_line(folder: Path, words: tuple[str, ...], reason: str) -> None:
    with pytest.raises(AmbError, match=reason) as problem:
        amb("validate", folder / words[0], folder / words[1], *words[2:])
    assert "\n" not in str(problem.value)


def test_compare_puts_the_best_model_first_and_says_which_it_refused(folder: Path, tmp_path: Path) -> None:
    models = [folder / f"{name}.json" for name in ("poor", "slow", "good")]
    result = amb("compare", *models, folder / "bag", "--results", tmp_path / "s.json")
    assert result.exit_code == 0
    assert "slow: the data have a sample time of 0.0001 s" in result.stdout
    values = json.loads((tmp_path / "s.json").read_text())
    assert list(values["models"]) == ["good", "poor"] and list(values["refused"]) == ["slow"]


@pytest.mark.slow
def test_compare_draws_the_models_over_one_another(folder: Path, tmp_path: Path) -> None:
    assert (
        amb("compare", folder / "good.json", folder / "poor.json", folder / "bag", "--figures", tmp_path).exit_code == 0
    )
    for name in ("response", "prediction", "bode", "residuals_1", "residuals_2"):
        assert (tmp_path / f"{name}.png").exists() and (tmp_path / f"{name}.html").exists()


def test_compare_of_no_usable_model_is_an_error(folder: Path) -> None:
    with pytest.raises(IdentificationError, match="none of the models could be validated"):
        amb("compare", folder / "slow.json", folder / "bag")


def test_models_of_one_name_are_told_apart_by_their_folders(folder: Path, tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        StateSpaceModel.load(folder / "good.json").save(tmp_path / name / "model.json")
    result = amb(
        "compare", tmp_path / "first/model.json", tmp_path / "second/model.json", folder / "bag",
        "--results", tmp_path / "s.json",
    )  # fmt: skip
    assert result.exit_code == 0
    assert set(json.loads((tmp_path / "s.json").read_text())["models"]) == {"first/model", "second/model"}


def test_a_bag_knows_its_controller_and_its_simulated_plant(record: LoopRecord, tmp_path: Path) -> None:
    gains = ControllerParameters(proportional_gain=15_000.0)
    known = read(write_bag(tmp_path / "known", record, gains, plant=True))
    assert known.controller == gains and known.plant is not None and known.plant.rotor.gravity == 9.0
    unknown = read(write_bag(tmp_path / "unknown", record, None))
    assert unknown.controller is None and unknown.plant is None
    assert np.array_equal(unknown.data.record().position, record.position)
