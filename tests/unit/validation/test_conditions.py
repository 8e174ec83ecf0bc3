"""The verdict is the worst of its conditions, and each names what does not hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.experiments import detrend
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, StateSpaceModel, Validation, to_continuous, validate
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.identification.progress import SearchEnd
from amb_core.identification.validation import Condition, Verdict, predict
from amb_core.identification.validation.judge import rule_table
from amb_core.identification.validation.model_error import response_errors
from amb_core.identification.validation.overlap import fingerprint_of, overlap
from amb_core.identification.validation.ringing import Ringing, find_ringing
from amb_core.identification.validation.verdict import worst_of
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.report.pages.document import Section, TableBlock, text_of
from amb_core.report.pages.validation import validation_section, verdict_badge
from amb_core.robustness import certify

NOISE, FORCE = 2e-8, 0.1  # m, N: rms on sensors and rotor
CONTROLLER = ControllerParameters()


def noise_of(model: StateSpaceModel) -> np.ndarray:
    """Standard deviation of the prediction errors."""
    return np.sqrt(np.diag(model.innovation_covariance))


def condition(validation: Validation, key: str) -> Condition:
    (one,) = (one for one in validation.conditions if one.key == key)
    return one


def test_the_verdict_is_the_worst_of_its_conditions() -> None:
    def of(*levels: Verdict) -> Verdict:
        return worst_of([Condition("key", "name", "finding", "limit", level) for level in levels])

    good, limited, bad = Verdict
    assert of(good, good) is good and of(good, limited, good) is limited and of(limited, bad, good) is bad
    assert of() is bad, "nothing was checked"
    assert [level.code for level in Verdict] == ["validated", "validated_with_reservations", "not_validated"]


def test_a_true_plant_without_a_noise_part_is_validated_with_that_reservation_alone(
    bearing, model: StateSpaceModel, data: IdentificationData
) -> None:
    plant = bearing.model
    bare = replace(model, k=np.zeros_like(model.k), innovation_covariance=np.zeros((2, 2)))
    system = LinearSystem(plant.a, plant.b, plant.c, plant.d, plant.sample_time)
    for given in (bare, system, system.to_control()):
        validation = validate(given, data, CONTROLLER)
        assert [(one.key, one.level) for one in validation.failed] == [("noise_model", Verdict.RESERVATIONS)]
        assert validation.one_step_fit == pytest.approx(validate(model, data, CONTROLLER).one_step_fit, abs=0.01)
    ungiven = condition(replace(validation, model=bare, noise_from_data=False), "noise_model")
    assert ungiven.level is Verdict.RESERVATIONS and "nor do these data give one" in ungiven.finding
    validation = validate(replace(bare, b=1.1 * bare.b), data, CONTROLLER)
    assert not validation.validated and condition(validation, "deviations").level is Verdict.NOT_VALIDATED


def test_a_plant_in_continuous_time_is_taken_with_held_inputs(
    bearing, model: StateSpaceModel, data: IdentificationData
) -> None:
    plant = LinearSystem.from_control(to_continuous(model))
    assert [one.key for one in validate(plant, data, CONTROLLER).failed] == ["noise_model"]
    with pytest.raises(IdentificationError, match="the data have 2 inputs and 2 outputs, the model 1 and 2"):
        validate(plant.part(slice(None), [0]), data, CONTROLLER)


@pytest.fixture(scope="module")
def quiet(bearing) -> IdentificationData:
    """Squares hardly larger than the noise: 1 um, 100 times the noise of the other data on the rotor."""
    record = bearing.experiment(NOISE, force=2.0, frequency=20.0, duration=0.6, amplitude=1e-6)
    return IdentificationData.from_record(record)


def test_the_true_model_is_validated_where_the_noise_leaves_little_of_the_fit(
    bearing, model: StateSpaceModel, quiet: IdentificationData
) -> None:
    by_force = bearing._matrices[1][:, 2:]
    k = kalman_gain(
        model.a, model.c, by_force @ by_force.T * 2.0**2, np.eye(2) * NOISE**2, np.zeros((model.order, 2))
    )  # fmt: skip
    validation = validate(replace(model, k=k), quiet, CONTROLLER)
    assert validation.fit.min() < 80.0, "the old limit was 90 %"
    assert validation.verdict == "validated", validation.report()


@pytest.mark.parametrize("more", [-0.1, 0.1])
def test_a_gain_that_is_off_is_refused_and_measured_though_the_closed_loop_follows(
    data: IdentificationData, model: StateSpaceModel, more: float
) -> None:
    validation = validate(replace(model, b=model.b * [1.0 + more, 1.0]), data, CONTROLLER)
    assert validation.verdict == "not validated" and validation.fit.min() > 90.0
    (gain,) = (one for one in validation.deviations if one.name == "gain of i_x")
    assert gain.value == pytest.approx(-100.0 * more / (1.0 + more), abs=3.0)
    band = max(validation.band_errors, key=lambda band: -band.p_value)
    assert band.input_name == "i_x"


def test_a_dead_time_of_one_sample_is_refused_and_measured(data: IdentificationData, model: StateSpaceModel) -> None:
    n = model.order
    a, b, c, k = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 2)), np.zeros((2, n + 2)), np.zeros((n + 2, 2))
    a[:n, :n], a[:n, n:], b[n:], c[:, :n], k[:n] = model.a, model.b, np.eye(2), model.c, model.k
    late = replace(model, a=a, b=b, c=c, k=k, initial_state=np.zeros(n + 2))
    validation = validate(late, data, CONTROLLER)
    assert validation.verdict == "not validated" and not condition(validation, "deviations").passed
    (both,) = (one for one in validation.deviations if one.name == "dead time of all inputs")
    assert both.value == pytest.approx(-1.0, abs=0.3)


def test_data_of_the_identification_are_recognised_under_another_name(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    known = replace(model, fingerprint=fingerprint_of(data, noise_of(model)))
    again = replace(data, experiments=tuple(replace(item, source="another.csv") for item in data.experiments))
    for part in (again, again.window(1_000, 5_500), detrend(again)):
        validation = validate(known, part, CONTROLLER)
        assert not condition(validation, "fresh_data").passed and validation.verdict == "validated with reservations"
    assert overlap(known.fingerprint, data.window(0, 3_000)) == pytest.approx(0.5, abs=0.2)


def test_other_data_of_the_same_experiment_are_not_taken_for_those_of_the_identification(
    bearing, data: IdentificationData, model: StateSpaceModel
) -> None:
    record = bearing.experiment(1.01 * NOISE, force=FORCE, frequency=20.0, duration=0.6)
    assert overlap(fingerprint_of(data, noise_of(model)), IdentificationData.from_record(record)) == 0.0


def test_a_fingerprint_survives_every_kind_of_file(model: StateSpaceModel, data: IdentificationData, tmp_path) -> None:
    known = replace(model, fingerprint=fingerprint_of(data, noise_of(model)))
    for name in ("model.json", "model.npz", "model.mat"):
        known.save(tmp_path / name)
        assert np.array_equal(StateSpaceModel.load(tmp_path / name).fingerprint, known.fingerprint)


def test_a_search_that_did_not_converge_and_poles_that_are_not_decided_are_reservations(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    validation = validate(model, data, CONTROLLER, search=SearchEnd(20, 0.01, False))
    assert validation.verdict == "validated with reservations" and not condition(validation, "convergence").passed
    undecided = replace(validation, search=None, undecided="the interval of a pole contains 1")
    assert [one.key for one in undecided.failed] == ["poles"]


def test_another_controller_is_a_reservation(data: IdentificationData, model: StateSpaceModel) -> None:
    other = CONTROLLER.model_copy(update={"proportional_gain": 0.8 * CONTROLLER.proportional_gain})
    validation = validate(model, data, other)
    assert (
        "proportional gain" in condition(validation, "controller").finding
        or "K_P" in condition(validation, "controller").finding
    )
    assert not condition(validation, "controller").passed and validation.verdict != "validated"


def test_a_sensor_that_froze_is_a_reservation(data: IdentificationData, model: StateSpaceModel) -> None:
    (item,) = data.experiments
    frozen = item.outputs.copy()
    frozen[2000:2600, 1] = frozen[2000, 1]
    validation = validate(model, replace(data, experiments=(replace(item, outputs=frozen),)), CONTROLLER)
    assert "frozen" in condition(validation, "samples").finding and validation.verdict != "validated"


def test_a_mode_that_the_model_lacks_rings_in_the_residuals_and_a_tone_is_none() -> None:
    random = np.random.default_rng(2)
    white, noise = random.normal(size=(2, 10_000, 1))
    pole = 0.995 * np.exp(2j * np.pi * 0.08)
    ringing = white + 0.05 * lfilter([1.0], np.real([1.0, -2.0 * pole.real, abs(pole) ** 2]), white, axis=0)
    peak = find_ringing([ringing], [noise], [ringing], 1e-4)
    assert peak is not None and peak.p_value < 1e-6 and peak.frequency == pytest.approx(800.0, rel=0.1)
    tone = white + 0.5 * np.sin(2.0 * np.pi * 0.08 * np.arange(10_000))[:, np.newaxis]
    for flat in (white, tone):
        peak = find_ringing([flat], [noise], [flat], 1e-4)
        assert peak is not None and peak.p_value > 1e-3


def test_a_missing_mode_is_found_beside_a_wrong_gain() -> None:
    random = np.random.default_rng(3)
    white, noise = random.normal(size=(2, 10_000, 1))
    pole = 0.98 * np.exp(2j * np.pi * 0.14)
    resonant = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    slow = lfilter([0.05], [1.0, -0.95], noise, axis=0)
    wrong_gain = white + np.vstack([[[0.0]], 2.0 * slow[:-1] / slow.std()])
    ringing = wrong_gain + 0.05 * lfilter([0.0, 1.0], resonant, white, axis=0)
    peak = find_ringing([ringing], [slow], [ringing], 1e-4)
    assert peak is not None and peak.p_value < 1e-6 and peak.height > 2.0
    assert peak.frequency == pytest.approx(1_400.0, rel=0.05)
    peak = find_ringing([wrong_gain], [slow], [wrong_gain], 1e-4)
    assert peak is not None and peak.p_value > 1e-3


def test_a_peak_that_matters_is_not_hidden_by_a_more_significant_one_that_does_not() -> None:
    random = np.random.default_rng(5)
    white, noise = random.normal(size=(2, 10_000, 1))
    errors = white.copy()
    for gain, frequency in ((0.02, 0.03), (0.015, 0.1)):
        pole = 0.995 * np.exp(2j * np.pi * frequency)
        errors += gain * lfilter([0.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], white, axis=0)
    lines = np.fft.rfftfreq(10_000)[:, np.newaxis]
    motion = errors + 100.0 * np.fft.irfft(np.fft.rfft(noise, axis=0) * ((lines > 0.02) & (lines < 0.06)), axis=0)
    ringing = find_ringing([errors], [noise], [motion], 1e-4)
    assert ringing is not None and ringing.p_value < 1e-3 and ringing.frequency == pytest.approx(1_000.0, rel=0.05)


def test_errors_that_ring_little_leave_reservations(validation: Validation) -> None:
    for share, level in ((0.05, "validated with reservations"), (0.5, "not validated")):
        changed = replace(validation, ringing=Ringing(3_000.0, 5.0, share, 1e-9, 1e-9))
        assert condition(changed, "ringing").level == level and "3000 Hz" in condition(changed, "ringing").finding


def test_an_input_that_is_still_in_the_longest_experiment_is_no_error(model: StateSpaceModel) -> None:
    random = np.random.default_rng(4)
    e, u = random.normal(size=(2, 4_000, 2))
    u[:, 1] = 0.0
    assert find_ringing([e], [u], [e], 1e-4) is not None
    assert find_ringing([e * [1.0, 0.0]], [u], [e], 1e-4) is None


def test_bands_end_where_the_excitation_does(data: IdentificationData, model: StateSpaceModel) -> None:
    random = np.random.default_rng(1)
    errors = 1e-8 * random.standard_normal((6_000, 2))
    for highest in (1_000.0, 4_990.0):
        time = np.arange(6_000)[:, np.newaxis] / 10_000.0
        tones = np.arange(60, round(0.6 * highest)) / 0.6
        phases = random.uniform(0.0, 2.0 * np.pi, (2, len(tones)))
        excited = 0.1 * np.column_stack([np.cos(2.0 * np.pi * tones * time + phase).sum(axis=1) for phase in phases])
        quiet = replace(data, experiments=(replace(data.experiments[0], inputs=excited),))
        bands = response_errors(model, quiet, [errors], open_loop=True)
        assert max(band.high for band in bands) == pytest.approx(tones[-1])


def test_references_that_move_together_say_nothing(data: IdentificationData, model: StateSpaceModel) -> None:
    item = data.experiments[0]
    together = replace(item, reference=np.repeat(item.inputs[:, :1], 2, axis=1))
    alike = replace(data, experiments=(together,))
    assert response_errors(model, alike, predict(model, alike).residuals) == ()


def test_the_page_is_never_green_above_a_condition_that_does_not_hold(
    data: IdentificationData, model: StateSpaceModel, validation: Validation
) -> None:
    models = (model, replace(model, b=1.01 * model.b), replace(model, b=1.2 * model.b), replace(model, b=-model.b))
    for number, one in enumerate(models):
        for law in (CONTROLLER, None):
            of_one = validate(one, data, law)
            section = text_of_section(validation_section(of_one))
            best = max((item.level for item in of_one.conditions), key=list(Verdict).index)
            assert of_one.verdict is best
            assert verdict_badge(of_one).state == {"validated": "good"}.get(of_one.verdict, verdict_badge(of_one).state)
            if of_one.failed:
                assert verdict_badge(of_one).state != "good", (number, law)
                for item in of_one.failed:
                    assert item.finding in section
            for line in of_one.report().splitlines():
                if line.startswith(("    RESERVED", "    FAILED")):
                    assert "VERDICT      validated\n" not in of_one.report()


def test_a_certificate_takes_the_word_of_the_validation(
    data: IdentificationData, model: StateSpaceModel, validation: Validation
) -> None:
    """Without a loop there is none, with reservations it says so."""
    unknown = certify(model, CONTROLLER, validation=validate(model, data))
    assert not unknown.checks[0].passed and "controller is not known" in unknown.verdict
    assert certify(model, CONTROLLER, validation=validation).reserved is False
    reserved = validate(replace(model, fingerprint=fingerprint_of(data, noise_of(model))), data, CONTROLLER)
    certificate = certify(model, CONTROLLER, validation=reserved)
    assert certificate.checks[0].passed and certificate.reserved
    assert any("samples of the identification" in text for text in certificate.warnings)


def test_the_rule_is_on_the_page_about_validation() -> None:
    page = Path(__file__).parents[3] / "docs" / "explanation" / "validation.md"
    assert rule_table() in page.read_text(encoding="utf-8"), "put in what rule_table() returns"


def text_of_section(section: Section) -> str:
    return " ".join(
        text_of(cell)
        for block in section.blocks
        if isinstance(block, TableBlock)
        for row in block.rows
        for cell in row
    )  # fmt: skip
