"""A certificate is computed again from its certificate.json and its files: the same numbers, or what differs."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.exit_codes import NOT_THE_SAME
from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import AmbError
from amb_core.identification import identify
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters, pd_as_linear
from amb_core.report.pages.again import certify_again
from amb_core.report.pages.certificate import write_certificate
from amb_core.report.pages.certification import Request, certify_request
from amb_core.robustness import RobustnessSettings, sha256_of
from amb_core.robustness.trace import CertificateHeader, controller_from, controller_values
from tests.unit.test_recording_report import write_bag

HEADER = CertificateHeader(machine="blower 3", serial_number="0815", speed="12000 rpm", author="A. N. Engineer")
FEW = RobustnessSettings(frequencies=60.0)


@pytest.fixture(scope="module")
def made(bearing, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with model, bag and certificate."""
    folder = tmp_path_factory.mktemp("again")
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    bag, model = write_bag(folder / "bag", record), folder / "model.json"
    identify(IdentificationData.from_record(record), 6, controller=ControllerParameters()).model.save(model)
    request = Request(str(model), "paper", str(bag), settings=FEW, header=HEADER)
    write_certificate(certify_request(request), folder)
    return folder


@pytest.fixture
def copied(made: Path, tmp_path: Path) -> Path:
    """The same elsewhere, with nothing at the old place."""
    return Path(shutil.copytree(made, tmp_path / "elsewhere"))


def content(folder: Path) -> dict:
    return json.loads((folder / "certificate.json").read_text())


def forget_places(folder: Path) -> None:
    """As if the files had lain in a folder that is gone."""
    values = content(folder)
    for name in ("model", "bag"):
        values["request"][name] = f"/gone/{Path(values['request'][name]).name}"
    (folder / "certificate.json").write_text(json.dumps(values))


def test_the_certificate_names_machine_data_controller_program_and_standards(made: Path) -> None:
    values = content(made)
    assert values["header"]["machine"] == "blower 3"
    assert values["made"]["version"] and values["made"]["date"].endswith("+00:00")
    assert values["controller"]["parameters"]["proportional_gain"] == 20_000.0
    (data,) = values["data"].values()
    assert data["amplitude"]["x"] > 0.0
    low, high = data["excited_band"]
    assert 0.0 < low < 20.0 < high < 5_000.0
    assert {one["standard"] for one in values["standards"]} >= {"ISO 14839-2", "ISO 14839-3"}
    page = (made / "certificate.html").read_text()
    for text in ("blower 3", "0815", "12000 rpm", "A. N. Engineer", "derivative_gain", "2006", "date and signature"):
        assert text in page


def test_the_same_files_give_the_same_numbers_wherever_they_lie(copied: Path) -> None:
    forget_places(copied)
    result = CliRunner().invoke(app, ["certify", "--again", str(copied / "certificate.json")], catch_exceptions=False)
    assert result.exit_code == 0, result.stdout
    assert "The same certificate" in result.stdout


def test_a_changed_bag_is_named_by_its_hash(bearing, copied: Path) -> None:
    forget_places(copied)
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    shutil.rmtree(copied / "bag")
    write_bag(copied / "bag", replace(record, position=1.01 * record.position))
    result = CliRunner().invoke(app, ["certify", "--again", str(copied / "certificate.json")], catch_exceptions=False)
    assert result.exit_code == NOT_THE_SAME
    assert "differs: bag bag: the SHA-256 of the samples is" in result.stdout
    assert "measured.peaks.x" in result.stdout


def test_a_changed_model_a_number_and_a_version_are_named(copied: Path) -> None:
    forget_places(copied)
    model = StateSpaceModel.load(copied / "model.json")
    replace(model, b=1.001 * model.b).save(copied / "model.json")
    values = content(copied)
    values["made"]["version"] = "0.0.1"
    values["mu"]["upper"] *= 2.0
    (copied / "certificate.json").write_text(json.dumps(values))
    certificate = certify_again(copied / "certificate.json")
    assert any(text.startswith("model: its matrices have the SHA-256") for text in certificate.differences)
    assert any(text.startswith("mu.upper: ") for text in certificate.differences)
    assert any(text.startswith("version of the workbench: ") for text in certificate.remarks)


def test_a_missing_file_and_another_json_are_refused_by_name(copied: Path, tmp_path: Path) -> None:
    forget_places(copied)
    shutil.rmtree(copied / "bag")
    with pytest.raises(AmbError, match="bag /gone/bag: there is no such file"):
        certify_again(copied / "certificate.json")
    (tmp_path / "other.json").write_text('{"certified": true}')
    with pytest.raises(AmbError, match=r"has no request, settings.*of an earlier version"):
        certify_again(tmp_path / "other.json")


def test_a_controller_is_made_again_from_its_gains_without_loss() -> None:
    linear = LinearControl(pd_as_linear(ControllerParameters()), LinearControllerParameters(current_limit=2.0))
    for law in (ControllerParameters(proportional_gain=21_000.1), linear):
        values = json.loads(json.dumps(controller_values(law)))
        assert controller_from(values) == law
    values["model"]["d"][0][0] *= 1.01
    with pytest.raises(AmbError, match="not those of its SHA-256"):
        controller_from(values)


def test_no_pdf_of_another_certificate_stays_beside_a_new_one(copied: Path) -> None:
    (copied / "certificate.pdf").write_bytes(b"Certified. To be signed.")
    (copied / "certificate.html").unlink()
    certificate = certify_again(copied / "certificate.json").certificate
    write_certificate(certificate, copied)
    assert not (copied / "certificate.pdf").exists()


def test_the_hash_of_a_file_is_the_one_that_every_tool_prints(tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_bytes(b"u,y\n1,2\n")
    assert sha256_of(file) == hashlib.sha256(file.read_bytes()).hexdigest()
    of_folder = sha256_of(tmp_path)
    file.rename(tmp_path / "other.csv")
    assert sha256_of(tmp_path) != of_folder != sha256_of(tmp_path / "other.csv")
