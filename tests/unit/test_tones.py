"""Tones that the reference lacks, as of an unbalance, stand neither in the model nor in its validation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.analysis import evidence_of_run
from amb_core.data.analysis.reading import read_recording
from amb_core.data.experiments import IdentificationData, write_data
from amb_core.data.experiments.checks import evidence_of
from amb_core.data.experiments.tones import cure_tones, without_unanswered
from amb_core.identification import identify, validate
from amb_core.identification.validation.verdict import Verdict
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.recording import BagWriter, Recording
from amb_core.robustness.error_band import error_band
from amb_core.robustness.feedback import feedback_of
from tests.bag_messages import TELEMETRY, definition, telemetry
from tests.benchmarks.robust.misfit_plants import draw

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
    assert validation.removed_tones == pytest.approx([97.3], abs=0.01)
    assert validation.verdict is not Verdict.NOT_VALIDATED


def test_they_are_no_distortion(turning) -> None:
    evidence = evidence_of(turning)
    assert evidence.coherence is not None
    assert np.max(evidence.coherence.ratio) < 0.3


def test_every_answer_on_distortion_leaves_them_out_and_says_so(turning, tmp_path) -> None:
    write_data(turning, tmp_path / "turning.csv")
    file, _ = read_recording(tmp_path / "turning.csv")
    bag = Recording.read(written_bag(tmp_path / "bag", turning.record()))
    checked = evidence_of(turning)
    for evidence in (checked, evidence_of_run(file), evidence_of_run(bag)):
        assert evidence.tones == pytest.approx([97.3], abs=0.01)
        assert evidence.coherence is not None
        assert evidence.coherence.ratio == pytest.approx(checked.coherence.ratio, rel=0.05)
        assert any("left out: 97.3 Hz" in line for line in evidence.lines)


def written_bag(folder: Path, record: LoopRecord) -> Path:
    """A bag with one message of telemetry."""
    with BagWriter(folder) as bag:
        bag.add_topic("/amb/telemetry", TELEMETRY, definition(TELEMETRY))
        bag.write("/amb/telemetry", telemetry(record), 0)
    return folder


def with_tone(data: IdentificationData, frequency: float, growth: float = 0.0) -> IdentificationData:
    """With a tone of 2 um on both sensors, or one that grows over the record."""
    (item,) = data.experiments
    time = np.arange(item.steps) * data.sample_time
    size = 2e-6 * (1.0 + growth * np.linspace(-1.0, 1.0, item.steps))
    tone = size * np.sin(2.0 * np.pi * frequency * time)
    return replace(data, experiments=(replace(item, outputs=item.outputs + tone[:, np.newaxis]),))


@pytest.mark.parametrize("frequency", [300.0, 299.83])
def test_it_need_not_be_much_larger_than_the_answer_to_the_reference(at_rest, frequency) -> None:
    cure = cure_tones(with_tone(at_rest, frequency))
    assert cure is not None
    assert cure.frequencies == pytest.approx([frequency], abs=0.01)


def test_multiples_of_the_frequency_of_a_periodic_reference_are_distortion_and_stay(bearing) -> None:
    record = bearing.experiment(kind="multisine", **TURNING | {"drift": "", "duration": 1.0, "periods": 2})
    periodic = IdentificationData.from_record(record)
    assert cure_tones(with_tone(periodic, 300.0)) is None
    for frequency in (301.0, 300.4):  # the next line of the record, and between the two
        assert cure_tones(with_tone(periodic, frequency)) is not None


def spread_lines(seed: int, spacing: tuple[int, int]) -> IdentificationData:
    """Two seconds of a reference of single lines, so many lines of the record apart, and the answer of a loop to it."""
    rng, steps, sample_time = np.random.default_rng(seed), 20_000, 1e-4
    spectrum = np.zeros(steps // 2 + 1, complex)
    lines = np.cumsum(rng.integers(spacing[0], spacing[1] + 1, steps))
    lines = lines[lines < 4_000]
    spectrum[lines] = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
    reference = np.fft.irfft(spectrum, steps)
    reference *= 10e-6 / np.abs(reference).max()
    pole = np.exp((-60.0 + 2j * np.pi * 160.0) * sample_time)  # 160 Hz, a damping ratio of 0.06
    ahead = np.concatenate([reference[-2_000:], reference])  # it answers to what was before, too
    denominator = np.poly([pole, pole.conj()])
    outputs = lfilter([0.0, denominator.sum()], denominator, ahead)[2_000:] + 0.05e-6 * rng.normal(size=steps)
    inputs = 8_000.0 * (reference - outputs)
    one = (inputs[:, np.newaxis], outputs[:, np.newaxis], sample_time)
    return IdentificationData.from_arrays(*one, reference=reference[:, np.newaxis])


@pytest.mark.parametrize("spacing", [(4, 6), (3, 7), (2, 9), (5, 5)])
def test_the_reference_s_own_lines_stay_however_near_they_are_to_each_other(spacing: tuple[int, int]) -> None:
    for seed in range(2):
        data = spread_lines(seed, spacing)
        assert cure_tones(data) is None
        assert cure_tones(data.window(777, 20_000)) is None  # they fall between the lines of this record


@pytest.mark.parametrize("frequency", [98.3, 160.4, 401.7])
def test_tones_are_found_between_the_lines_of_a_reference(frequency: float) -> None:
    """Half a line of the record beside one, or more."""
    cure = cure_tones(with_tone(spread_lines(0, (5, 5)), frequency))
    assert cure is not None
    assert cure.frequencies == pytest.approx([frequency], abs=0.05)


def test_what_grows_over_the_record_may_be_a_narrow_mode_and_stays(at_rest) -> None:
    assert cure_tones(with_tone(at_rest, 299.83, growth=0.8)) is None


def test_a_mode_that_rings_for_as_long_as_the_record_stays() -> None:
    """A damping ratio of 0.003 at 38 Hz, in 0.8 s: one line of the record, as a tone would be."""
    record = draw("mode inside", 10).record(8_000, 20)
    assert record is not None
    assert cure_tones(IdentificationData.from_record(record)) is None


def test_the_error_of_a_model_is_known_at_a_tone_too() -> None:
    """A hole of the known band there would leave no statement on stability."""
    bearing = draw("unbalance", 6)  # at 444 Hz
    record = bearing.record(20_000, 12)
    assert record is not None
    turning = IdentificationData.from_record(record)
    model = identify(turning, bearing.order, controller=bearing.mild).model
    action = feedback_of(model, bearing.mild).action
    bands = [error_band(model, [data], 0.001, action=action) for data in (without_unanswered(turning), turning)]
    left = [band.within(np.array([bearing.loop.speed]))[1][0] for band in bands if band is not None]
    assert left[0] < 0.5 < left[1]
