"""Tones that the reference lacks, as of an unbalance, stand neither in the model nor in its validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks import evidence_of
from amb_core.data.experiments.tones import cure_tones
from amb_core.identification import identify, validate
from amb_core.identification.validation.verdict import Verdict
from amb_core.loop.control import ControllerParameters

BAND = {"amplitude": 5e-6, "frequency_start": 2.0, "frequency_end": 2_000.0, "axes": "all"}
TURNING = {"noise": 2e-8, "force": 0.1, "drift": "runout", **BAND}  # 2 um at 97.3 Hz


@pytest.fixture(scope="module")
def turning(bearing) -> IdentificationData:
    return IdentificationData.from_record(bearing.experiment(kind="multisine", **TURNING))


@pytest.fixture(scope="module")
def at_rest(bearing) -> IdentificationData:
    return IdentificationData.from_record(bearing.experiment(kind="multisine", **TURNING | {"drift": ""}))


def test_they_are_found_where_a_sensor_has_runout_and_else_nowhere(turning, at_rest) -> None:
    cure = cure_tones(turning)
    assert cure is not None
    assert cure.frequencies == pytest.approx([97.3], abs=0.01)
    assert "unbalance: 97.3 Hz" in cure.summary
    assert cure_tones(at_rest) is None


def test_they_are_gone_from_all_signals_and_the_rest_stays(turning, at_rest) -> None:
    cure = cure_tones(turning)
    assert cure is not None
    (calm,), (turned,), (quiet,) = cure.data.experiments, turning.experiments, at_rest.experiments
    settled = slice(2_000, None)  # the loop answers to the start of the tone
    left, right = (np.std(item.outputs[settled] - quiet.outputs[settled], axis=0) for item in (calm, turned))
    assert np.all(left < 0.1 * right)  # a line of the multisine, and no other


def test_a_turning_rotor_is_identified_as_one_at_rest(bearing, turning, at_rest) -> None:
    found, still, given = (
        identify(data, 6, drift=option) for data, option in ((turning, "auto"), (at_rest, "auto"), (turning, "none"))
    )
    errors = [bearing.response_error(result.model) for result in (found, still, given)]
    assert errors[0] < 1.5 * errors[1] < errors[2]
    assert "unbalance: 97.3 Hz" in found.summary
    assert found.tones is not None and found.data is turning
    assert found.verdict is not Verdict.NOT_VALIDATED


def test_a_validation_names_them_and_judges_the_rest(turning, at_rest) -> None:
    model = identify(at_rest, 6).model
    validation = validate(model, turning, ControllerParameters())
    assert any("unbalance: 97.3 Hz" in note for note in validation.notes)
    assert validation.verdict is not Verdict.NOT_VALIDATED


def test_they_are_no_distortion(turning) -> None:
    evidence = evidence_of(turning)
    assert evidence.coherence is not None
    assert np.max(evidence.coherence.ratio) < 0.3


def test_what_the_loop_may_answer_to_its_reference_stays(at_rest) -> None:
    """A narrow resonance between two lines looks like a tone, of less than ten times the amplitude of its line."""
    (item,) = at_rest.experiments
    time = np.arange(item.steps) * at_rest.sample_time
    line = np.abs(np.fft.rfft(item.reference, axis=0)).max() * 2.0 / item.steps
    answer = 6.0 * line * np.sin(2.0 * np.pi * 300.0 * time)[:, np.newaxis]
    answered = replace(at_rest, experiments=(replace(item, outputs=item.outputs + answer),))
    assert cure_tones(answered) is None
