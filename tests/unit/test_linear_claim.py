"""Region A is said of what was judged alone: alike by the command, its summary, the report and the figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_core.data.analysis import read_recording
from amb_core.data.analysis.recorded_regions import classify_run
from amb_core.report.figures.drawing import Span
from amb_core.report.figures.sweep import sweep_chart
from amb_core.report.linear_claim import LinearClaim
from amb_core.report.pages import Prose
from amb_core.report.pages.recording import recording_report

RATE, STEPS, STUCK = 10_000.0, 20_000, 8_000  # Hz, steps of the record, step from which the sensor of x is stuck


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A linear response of two axes to a sine; the sensor of x gets stuck while its current moves."""
    time, noise = np.arange(STEPS) / RATE, np.random.default_rng(0).standard_normal((STEPS, 2))
    reference = 5.0 * np.sin(2.0 * np.pi * 300.0 * time)[:, np.newaxis] * np.ones(2)
    position = 0.3 * reference + 0.05 * noise
    position[STUCK:, 0] = position[STUCK, 0]
    columns = np.column_stack([time, 0.008 * (reference - position), position, reference])
    file = tmp_path_factory.mktemp("stuck") / "stuck.csv"
    heading = "time [s],i_x [A],i_y [A],x [um],y [um],r_x [um],r_y [um]"
    np.savetxt(file, columns, delimiter=",", header=heading, comments="", fmt="%.9g")
    return file


def regions(table: Path, out: Path, *options: str) -> tuple[str, dict[str, Any]]:
    """What `amb regions` prints, and its summary."""
    command = ["regions", str(table), "--out", str(out), *options]
    said = CliRunner().invoke(app, command, catch_exceptions=False, env={"COLUMNS": "160"}).stdout
    return said, json.loads((out / "summary.json").read_text())


def rows(said: str) -> dict[str, list[str]]:
    """Cells of the table that the command prints, by part."""
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines() if "│" in line]
    return {row[0]: row[1:] for row in cells}


def test_the_command_says_no_region_of_a_sensor_that_is_stuck(table: Path, tmp_path: Path) -> None:
    said, summary = regions(table, tmp_path, "--clearance", "250um")
    assert [rows(said)[part][0] for part in ("rotor", "x", "y")] == ["", "", "A"]
    assert rows(said)["x"][-1] == "sensor of x dead or stuck"
    assert "in region A" not in said and "at the end none found" in said
    assert summary["region_at_end"] is None
    assert summary["shares"] == dict.fromkeys("ABCD")


def test_the_command_says_no_region_at_the_end_of_what_was_not_judged(table: Path, tmp_path: Path) -> None:
    said, summary = regions(table, tmp_path, "--axes", "y")
    assert "D not judged: the clearance is not known" in said
    assert (summary["region_at_end"], summary["shares"]["A"]) == (None, None)


def test_report_and_figure_say_no_region_of_a_sensor_that_is_stuck(table: Path) -> None:
    recording, _ = read_recording(table, clearance="250um")
    section = recording_report(recording, order=2).sections[0]
    texts = [block.text for block in section.blocks if isinstance(block, Prose)]
    assert texts[0].startswith(f"Position x steps {STUCK} to {STEPS - 1}: unchanged while its axis moves")
    assert "Share of the time in each region: none found: 100.0 %." in texts
    found = classify_run(recording)
    chart = sweep_chart(found.record, found.classification, frozen=found.frozen)
    assert "region A" not in chart.alt and "a dead or stuck sensor shows no region" in chart.alt
    spans = [item for item in chart.panels[0].items if isinstance(item, Span)]
    assert {(span.label, span.letter) for span in spans} == {("none found", "")}


def test_figure_says_no_region_of_what_was_not_judged(table: Path) -> None:
    recording, _ = read_recording(table)
    found = classify_run(recording)
    chart = sweep_chart(found.record, found.classification, frozen=found.frozen)
    assert "region A" not in chart.alt and "D not judged: the clearance is not known." in chart.alt


def test_a_sensor_counts_as_stuck_if_the_recording_or_a_state_says_so(table: Path) -> None:
    recording, _ = read_recording(table, clearance="250um")
    classification = classify_run(recording).classification
    assert LinearClaim.of(classification).still == ("x",)
    claim = LinearClaim.of(classification, ["y steps 10 to 90"])
    assert claim.still == ("x", "y") and not claim.holds("y")
