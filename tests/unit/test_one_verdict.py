"""The same model and data get the same verdict from every command, on every page and by every exit code."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.exit_codes import NOT_CERTIFIED, NOT_VALIDATED
from amb_core.designs.excitation.excited_order import ExcitedOrder
from amb_core.identification.fit import fit_text
from tests.unit.test_recording_report import write_bag

VERDICTS = ("not validated", "validated with reservations", "validated")  # the longest first, as one ends with another


def amb(*words: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    return result.exit_code, result.output


def verdict_in(text: str) -> str:
    """The first verdict that a text names."""
    words = re.search("|".join(VERDICTS), " ".join(text.split()))
    assert words, text
    return words.group()


@pytest.fixture(scope="module")
def bag(bearing, tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = bearing.experiment(
        2e-9, "multisine", force=0.01, amplitude=10e-6, duration=1.2, frequency_start=2.0, frequency_end=4_500.0,
        axes="all",
    )  # fmt: skip
    return write_bag(tmp_path_factory.mktemp("agreement") / "bag", record)


@pytest.mark.parametrize(("order", "validated"), [(6, True), (2, False)], ids=["right order", "too low an order"])
def test_all_agree(order: int, validated: bool, bag: Path, tmp_path: Path) -> None:
    model, report = tmp_path / "model.json", tmp_path / "report.html"
    code, identified = amb("identify", bag, "--order", order, "--out", model)
    assert code == 0
    verdicts = {"identify": verdict_in(identified.split("verdict")[1])}

    code, _ = amb("validate", model, bag, "--results", tmp_path / "validation.json")
    assert code == (0 if validated else NOT_VALIDATED)
    verdicts["validate"] = json.loads((tmp_path / "validation.json").read_text())["verdict"]

    code, table = amb("compare", model, bag, "--results", tmp_path / "comparison.json")
    assert code == (0 if validated else NOT_VALIDATED)
    (compared,) = json.loads((tmp_path / "comparison.json").read_text())["models"].values()
    verdicts["compare"], verdicts["table of compare"] = compared["verdict"], verdict_in(table.split("verdict")[1])

    assert amb("report", bag, "--order", order, "--no-certify", "--out", report)[0] == 0
    verdicts["report"] = verdict_in(report.read_text().split('class="outcome"')[1])

    code, stated = amb("certify", model, "--bag", bag, "--frequencies", 50, "--out", tmp_path / "certificate")
    certificate = json.loads((tmp_path / "certificate" / "certificate.json").read_text())
    check = next(one for one in certificate["checks"] if one["name"] == "the model is validated")
    verdicts["certify"] = verdict_in(check["finding"])
    assert check["passed"] is validated
    assert (code == 0) is certificate["certified"]
    if not validated:
        assert code == NOT_CERTIFIED
        assert "Not certified: not validated" in " ".join(stated.split())

    assert len(set(verdicts.values())) == 1, verdicts
    assert (verdicts["validate"] != "not validated") is validated


def test_a_fit_below_zero_is_no_percentage_beside_others() -> None:
    assert [fit_text(value) for value in (99.0, 0.0, -5034.0)] == ["99.00 %", "0.00 %", "below 0 %"]


def test_the_order_that_data_allow_reads_as_a_maximum() -> None:
    assert str(ExcitedOrder(12, 20)) == "up to 12"
    assert str(ExcitedOrder(20, 20)) == "up to 20, higher ones were not tried"
