"""The report on a recording: regions, motion and model; where there is no model, why, at the top and in its section."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from amb_bringup.cli import app
from amb_core.ground.errors import AmbError
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter, Recording
from amb_core.report.pages import Badge, FigureBlock, Prose, Report, Section, TableBlock
from amb_core.report.pages.document import text_of
from amb_core.report.pages.recording import recording_report
from tests.bag_messages import PARAMETERS, TELEMETRY, definition, telemetry


def write_bag(folder: Path, *records: LoopRecord, controller: bool = True) -> Path:
    with BagWriter(folder) as bag:
        for topic, kind in (("/amb/telemetry", TELEMETRY), ("/parameter_events", PARAMETERS)):
            bag.add_topic(topic, kind, definition(kind))
        if controller:
            bag.write_parameters("/parameter_events", "/amb/pd_controller", ControllerParameters().model_dump(), 0)
        for record in records:
            bag.write("/amb/telemetry", telemetry(record), 0)
    return folder


@pytest.fixture(scope="module")
def excited(bearing, tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = bearing.experiment(
        2e-9, "multisine", force=0.01, amplitude=10e-6, duration=1.2, frequency_start=2.0, frequency_end=4_500.0,
        axes="all",
    )  # fmt: skip
    return write_bag(tmp_path_factory.mktemp("report") / "excited", record)


@pytest.fixture(scope="module")
def resting(bearing, tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6)
    still = np.zeros_like(record.position)
    record = replace(record, reference=still, position=still, current=still)
    return write_bag(tmp_path_factory.mktemp("report") / "resting", record)


def amb_report(*words: object) -> Result:
    return CliRunner().invoke(app, ["report", *map(str, words)], catch_exceptions=False)


def test_a_report_has_regions_motion_model_response_and_validation(excited: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "report.html"
    result = amb_report(excited, "--order", 6, "--out", out)
    assert result.exit_code == 0
    assert "No model" not in result.stdout
    page = out.read_text(encoding="utf-8")
    for heading in (
        "Regions", "Distortion", "Motion", "Identified model", "Frequency response", "Validation", "Robustness",
    ):  # fmt: skip
        assert f'">{heading}</h2>' in page
    assert "Margins of each axis" in page
    assert "Bands hold the response with a confidence of 99 %" in page


def robustness_of(report: Report) -> Section:
    return next(section for section in report.sections if section.heading == "Robustness")


def badge_of(report: Report) -> Badge:
    assert report.strip is not None
    return dict(report.strip.numbers)["robustness"]


def test_the_robustness_is_that_of_the_certificate_with_bounds_and_figure(excited: Path) -> None:
    report = recording_report(Recording.read(excited), order=6, certified=True)
    verdict, *others = robustness_of(report).blocks
    assert isinstance(verdict, Prose)
    certified = verdict.text.startswith("Certified: stable, zone ")
    assert badge_of(report).state == ("good" if certified else "limited")
    assert badge_of(report).section == "Robustness"
    (table,) = (block for block in others if isinstance(block, TableBlock))
    assert [row[0] for row in table.rows] == ["x", "y"]
    assert all("zone" in text_of(row[2]) for row in table.rows), "the data give bounds"
    assert sum(isinstance(block, FigureBlock) for block in others) == 1


def test_a_model_that_is_not_validated_is_not_certified_and_the_section_has_the_reason(excited: Path) -> None:
    report = recording_report(Recording.read(excited), order=2, certified=True)
    (verdict, *_) = robustness_of(report).blocks
    assert isinstance(verdict, Prose)
    assert verdict.text.startswith("Not certified: not validated")
    assert badge_of(report).text.startswith("not certified")


def test_robustness_is_left_out_where_it_is_not_wanted(excited: Path, tmp_path: Path) -> None:
    amb_report(excited, "--order", 6, "--no-certify", "--out", tmp_path / "report.html")
    assert '">Robustness</h2>' not in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_gap_is_counted_and_the_response_is_said_to_be_of_one_part(excited: Path, tmp_path: Path) -> None:
    whole = Recording.read(excited).telemetry()
    first, middle = whole.first_step, whole.first_step + whole.steps // 2
    parts = whole.window(first, middle - 500 - first), whole.window(middle, first + whole.steps - middle)
    report = recording_report(Recording.read(write_bag(tmp_path / "gap", *parts)), order=6)
    table = next(block for block in report.opening if isinstance(block, TableBlock))
    rows = {text_of(row[0]): text_of(row[1]) for row in table.rows}
    assert rows["steps"] == f"{whole.steps}, from step {first} on"
    assert rows["samples"] == str(whole.steps - 500)
    titles = [block.title for section in report.sections for block in section.blocks if isinstance(block, FigureBlock)]
    last = first + whole.steps - 1
    part = f"the longest of 2 parts (steps {middle} to {last}); fits are of this part"
    assert f"Response of plant and model, {part}" in titles


def test_a_recording_is_read_once(excited: Path, tmp_path: Path) -> None:
    bag = shutil.copytree(excited, tmp_path / "bag")
    recording = Recording.read(bag)
    shutil.rmtree(bag)
    assert "No model" not in recording_report(recording, order=6).lead


def test_a_model_of_data_too_short_to_validate_it_is_shown_and_the_verdict_has_the_reason(
    bearing, tmp_path: Path
) -> None:
    record = bearing.experiment(2e-9, "multisine", force=0.01, amplitude=10e-6, duration=0.6, axes="all")
    bag = write_bag(tmp_path / "short", record.window(record.first_step + 2_000, 200))
    report = recording_report(Recording.read(bag), order=4, certified=True)
    assert report.strip is not None
    assert "No model" not in report.lead
    assert report.lead.startswith("0.0200 s ") and "Too short for regions B and C" in report.lead
    assert dict(report.strip.numbers)["worst region"].text == "not classified"
    assert [section.heading for section in report.sections[3:]] == ["Identified model", "Validation", "Robustness"]
    assert (report.strip.verdict.text, report.strip.verdict.section) == ("not validated", "Validation")
    reason = "200 samples are too few to test residuals over 25 lags"
    assert reason in report.strip.reason
    assert dict(report.strip.numbers)["robustness"].text == "not computed"
    for section in report.sections[4:]:
        (why,) = section.blocks
        assert isinstance(why, Prose) and reason in why.text


def test_without_excitation_the_report_says_at_its_top_why_there_is_no_model(resting: Path) -> None:
    report = recording_report(Recording.read(resting), order=6)
    assert [section.heading for section in report.sections] == ["Regions", "Distortion", "Motion", "Identified model"]
    assert " No model: " in report.lead
    (why,) = report.sections[-1].blocks
    assert isinstance(why, Prose) and why.text.startswith("There is none: ")


@pytest.mark.parametrize("order", [0, -3, 41])
def test_an_order_that_no_method_takes_is_refused_before_anything_is_written(
    excited: Path, tmp_path: Path, order: int
) -> None:
    with pytest.raises(AmbError, match=f"order {order} is not allowed; allowed: 1 to 40"):
        amb_report(excited, "--order", order, "--out", tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_no_controller_is_assumed_for_a_model(bearing, tmp_path: Path) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.4)
    bag = Recording.read(write_bag(tmp_path / "bare", record, controller=False))
    report = recording_report(bag, order=6)
    assert "No model: the bag lacks the controller's parameters; name it with --controller: paper" in report.lead
    assert "No model" not in recording_report(bag, order=6, controller=ControllerParameters()).lead
