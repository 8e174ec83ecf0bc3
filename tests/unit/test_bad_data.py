"""Bad data are named with the signal, the step and what to do; clean data are not accused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import Severity, check_data
from amb_core.data.experiments.checks import check_recording
from amb_core.identification import IdentificationData, identify, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from tests.benchmarks.verdicts.bad_data import KINDS, draw_clean, named, spoil
from tests.benchmarks.verdicts.drawn_loops import draw_record
from tests.linear_process import SIZES, LinearProcess


def accused(data: IdentificationData) -> list[str]:
    return [str(finding) for finding in check_recording(data) if finding.severity is not Severity.INFO]


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_is_named(kind: str) -> None:
    case = spoil(kind, np.random.default_rng(11))
    assert named(case), case.warnings
    assert all(finding.advice for finding in case.warnings)


def test_clean_records_are_not_accused() -> None:
    for seed in range(4):
        assert not draw_clean(np.random.default_rng([12, seed])).warnings


def test_a_simulated_bearing_is_not_accused() -> None:
    """Without noise, with jumps of the currents up to their limit."""
    excitation = np.zeros((2_500, 2))
    excitation[500:, 1] = 20e-6 * np.sign(np.sin(2.0 * np.pi * 12.0 * np.arange(2_000) / 10_000.0))
    record = simulate(Plant(), PdController(ControllerParameters()), 2_500, excitation)
    assert not accused(IdentificationData.from_record(record))


@pytest.mark.parametrize(("inputs", "outputs"), SIZES)
def test_a_process_in_open_loop_is_not_accused(inputs: int, outputs: int) -> None:
    assert not accused(LinearProcess(inputs, outputs).data())


def test_a_single_missing_row_is_found() -> None:
    record, _ = draw_record(np.random.default_rng(13), 4_000, axes=1)
    kept = np.arange(4_000) != 1_700
    signals = {name: getattr(record, name)[kept] for name in ("reference", "position", "current")}
    finding = check_data(IdentificationData.from_record(replace(record, **signals)), 4).finding("missing")
    assert finding.severity is Severity.WARNING and f"step {record.first_step + 1_700}" in finding.where


def test_identify_and_validate_name_an_outlier() -> None:
    record, loop = draw_record(np.random.default_rng(14), 4_000, axes=1)
    position = record.position.copy()
    position[1_000] += 1e-3
    bad = replace(record, position=position)
    identification = identify(record, 5, "ssarx", loop.controller)
    assert identification.report.finding("outliers").severity is Severity.INFO
    report = identify(bad, 5, "ssarx", loop.controller).report
    assert f"x step {record.first_step + 1_000}" in report.finding("outliers").where
    failed = validate(identification.model, IdentificationData.from_record(bad), loop.controller).failed
    assert any(f"outliers: x step {record.first_step + 1_000}" in one.finding for one in failed)


def test_interpolated_samples_are_found() -> None:
    record, _ = draw_record(np.random.default_rng(15), 4_000)
    time = np.arange(record.steps)
    finer = np.arange(0.0, record.steps - 1, 0.5)
    signals = [
        np.column_stack([np.interp(finer, time, column) for column in signal.T])
        for signal in (record.reference, record.position, record.current)
    ]
    data = IdentificationData.from_record(LoopRecord(0, 0.5 * record.sample_time, *signals, record.axes))
    assert any("interpolated" in text for text in accused(data))
