"""`amb certify`: exit code and files, from a recording to the certificate; certified only with data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from amb_bringup.cli import app
from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import AmbError
from amb_core.identification import identify
from amb_core.loop.control import ControllerParameters
from amb_core.robustness import SweepSettings
from tests.unit.test_recording_report import write_bag


@pytest.fixture(scope="module")
def files(bearing, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A model of the bearing's order, and the bag that it was identified from."""
    folder = tmp_path_factory.mktemp("certify")
    record = bearing.experiment(
        2e-9, "multisine", force=0.01, amplitude=10e-6, duration=1.2, frequency_start=2.0, frequency_end=4_500.0,
        axes="all",
    )  # fmt: skip
    bag, model = write_bag(folder / "bag", record), folder / "model.json"
    data = IdentificationData.from_record(record, source=str(bag))
    identify(data, 6, controller=ControllerParameters()).model.save(model)
    return model, bag


def amb_certify(model: Path, out: Path, *words: object) -> tuple[Result, dict]:
    given = ["certify", model, "--controller", "paper", "--out", out, *words]
    result = CliRunner().invoke(app, [str(word) for word in given], catch_exceptions=False)
    return result, json.loads((out / "certificate.json").read_text())


def test_the_help_names_every_kind_of_controller() -> None:
    shown = CliRunner().invoke(app, ["certify", "--help"], env={"COLUMNS": "200"}).output
    for kind in ("paper, pd:K_P,K_D", "pd:K_P,K_D,measurement", ".yaml", ".json, .npz or .mat"):
        assert kind in shown


def test_without_data_margins_are_computed_but_nothing_is_certified(files, tmp_path: Path) -> None:
    result, certificate = amb_certify(files[0], tmp_path)
    assert result.exit_code == 4
    assert certificate["certified"] is False and certificate["peak_sensitivity"]
    assert "not certified" in (tmp_path / "certificate.html").read_text()


def test_with_the_data_of_the_identification_the_certificate_says_so(files, tmp_path: Path) -> None:
    model, bag = files
    result, certificate = amb_certify(model, tmp_path, "--bag", bag)
    assert result.exit_code == (0 if certificate["certified"] else 4)
    assert [check["passed"] for check in certificate["checks"] if check["name"] == "the model is validated"] == [True]
    assert any("the samples of the identification are in these data" in text for text in certificate["warnings"])
    assert certificate["reserved"] is True
    assert not certificate["certified"] or certificate["verdict"].startswith("Certified with reservations")
    assert {name.split()[0] for name in certificate["inputs"]} == {"model", "bag", "controller"}
    assert certificate["bounds"]


def test_a_recorded_sweep_is_checked_and_compared_with_the_model(files, bearing, tmp_path: Path) -> None:
    sweep = SweepSettings(sweep_amplitude=5e-6, sweep_duration=6.0).excitation
    record = bearing.experiment(2e-8, "sweep", force=0.1, **sweep.model_dump())
    model, bag = files
    swept = write_bag(tmp_path / "swept", record)
    _, certificate = amb_certify(model, tmp_path / "out", "--bag", bag, "--sweep-bag", swept)
    (check,) = (one for one in certificate["checks"] if one["name"].startswith("measured by a swept sine"))
    assert check["passed"], check["finding"]
    assert certificate["measured"]["worst_difference_db"] < 0.5
    assert any(name.startswith("sweep bag") for name in certificate["inputs"])


def test_without_data_under_the_controller_to_certify_the_loop_is_predicted_only(files, tmp_path: Path) -> None:
    model, bag = files
    result, certificate = amb_certify(model, tmp_path, "--bag", bag, "--sweep-bag", bag, "--controller", "pd:25000,50")
    assert result.exit_code == 4
    assert not certificate["certified"]
    assert "no data are of a loop with this controller" in [check["finding"] for check in certificate["checks"]]
    assert any("left out: it is not of a loop with this controller" in text for text in certificate["warnings"])


def test_a_sweep_is_measured_or_given(files, tmp_path: Path) -> None:
    model, bag = files
    with pytest.raises(AmbError, match="give one of the two"):
        amb_certify(model, tmp_path, "--bag", bag, "--sweep-bag", bag, "--sweep-amplitude", "4um")
