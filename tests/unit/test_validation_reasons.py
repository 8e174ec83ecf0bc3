"""What a validation names is what is wrong: gains, tones, quantised and copied data, and no other cause beside it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.experiments.tones import find_tones, standing_out
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, StateSpaceModel, validate
from amb_core.identification.validation import Condition, Validation, predict
from amb_core.identification.validation.judge import OVERLAP
from amb_core.identification.validation.overlap import fingerprint_of, overlap
from amb_core.identification.validation.ringing import find_ringing
from amb_core.loop.control import ControllerParameters
from amb_core.regions.distortion import Coherence
from tests.benchmarks.verdicts.bearings import Bearing, draw_data

UNBALANCE = 0.0117316  # cycles per sample, between two lines of every record below


def condition(validation: Validation, key: str) -> Condition:
    return next(one for one in validation.conditions if one.key == key)


def noise_of(model: StateSpaceModel, data: IdentificationData) -> np.ndarray:
    """Standard deviation of the prediction errors."""
    return predict(model, data).residuals[0].std(axis=0)


def noise(steps: int = 10_000, signals: int = 2, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(steps, signals))


def tone(amplitude: float, steps: int = 10_000, frequency: float = UNBALANCE) -> np.ndarray:
    angle = 2.0 * np.pi * frequency * np.arange(steps)[:, np.newaxis]
    return amplitude * np.hstack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("amplitude", [1.0, 30.0, 1e3])
def test_a_tone_between_two_lines_is_found_and_subtracted(amplitude: float) -> None:
    tones = find_tones(noise() + tone(amplitude) + tone(0.4 * amplitude, frequency=2.0 * UNBALANCE))
    assert tones.frequencies == pytest.approx((UNBALANCE, 2.0 * UNBALANCE), abs=2e-6)
    assert tones.rest.std(axis=0) == pytest.approx([1.0, 1.0], abs=0.03)


def test_noise_and_a_mode_that_noise_drives_have_no_tones() -> None:
    assert find_tones(noise()).frequencies == ()
    pole = 0.999 * np.exp(2j * np.pi * 0.07)
    mode = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], noise(20_000), axis=0)
    assert find_tones(10.0 * mode / mode.std() + noise(20_000, seed=2)).frequencies == ()


def test_a_line_of_the_reference_is_no_disturbance() -> None:
    errors = noise() + tone(3.0)
    assert len(find_tones(errors, standing_out(noise(seed=3))).frequencies) == 1
    assert find_tones(errors, standing_out(5.0 * tone(1.0))).frequencies == ()


@pytest.mark.parametrize("amplitude", [1.0, 30.0, 1e3])
def test_an_unbalance_is_no_missing_mode(amplitude: float) -> None:
    """At a line of the record it was none; between two lines a rectangular window spreads it over hundreds."""
    errors = noise() + tone(amplitude)
    ringing = find_ringing([errors], [noise(seed=3) + tone(amplitude)], [errors], 1e-4)
    assert ringing is not None and ringing.p_value > 1e-3


BEARING = Bearing(
    axes=2, mass=6.25, coupling=(0.05,), current_gain=66.0, stiffness=3.3e5, bandwidth=2_000.0, frequency=700.0,
    damping=0.02, share=0.1, shape=(1.0, 0.7), proportional=2e4, derivative=38.0, keep=0.3, sensor_noise=1e-7,
    force_noise=0.02,
)  # fmt: skip


@pytest.fixture(scope="module")
def slow_predictor() -> tuple[StateSpaceModel, IdentificationData, ControllerParameters]:
    """A bearing whose predictor remembers long, excited up to a sharp edge: the truth, data and the controller."""
    random = np.random.default_rng(4)
    lines = np.fft.rfftfreq(10_000, 1e-4)
    excited = (lines >= 1.0) & (lines <= 1_500.0)
    spectrum = np.where(excited, 1.0, 0.0)[:, np.newaxis] * np.exp(2j * np.pi * random.uniform(size=(len(lines), 2)))
    reference = np.fft.irfft(spectrum, 10_000, axis=0)
    like = IdentificationData.from_arrays(reference, reference, 1e-4, reference=5e-6 * reference / reference.std())
    return BEARING.true_model(), draw_data(BEARING, random, 10_000, like)[0], BEARING.controller


def test_a_gain_is_named_as_a_gain_with_its_own_size(slow_predictor) -> None:
    model, data, controller = slow_predictor
    wrong = replace(model, b=model.b * [1.03, 1.0])
    validation = validate(wrong, data, controller)
    first, *others = validation.deviations
    assert first.name == "gain of i_1" and first.value == pytest.approx(-2.9, abs=0.3) and first.size < 1.0
    assert all(len(validation.deviations) * one.p_value > 1e-3 for one in others)
    assert condition(validation, "deviations").level == "validated with reservations"
    assert validation.verdict == "validated with reservations", validation.report()


def test_a_gain_of_all_inputs_leaves_nothing_to_stiffness_and_modes(slow_predictor) -> None:
    model, data, controller = slow_predictor
    validation = validate(replace(model, b=1.1 * model.b), data, controller)
    assert validation.deviations[0].name == "gain of all inputs"
    assert validation.deviations[0].value == pytest.approx(-9.1, abs=0.5)
    assert validation.verdict == "not validated" and "gain of all inputs" in condition(validation, "deviations").finding
    assert not any("mode" in one.name and one.p_value < 1e-6 for one in validation.deviations)


def with_tone(data: IdentificationData, amplitude: float) -> IdentificationData:
    """With a tone on what the sensors measure."""
    (item,) = data.experiments
    return replace(data, experiments=(replace(item, outputs=item.outputs + tone(amplitude, item.steps)),))


def test_an_unbalance_is_named_and_no_fault_of_the_plant_part(slow_predictor) -> None:
    model, data, _ = slow_predictor
    validation = validate(model, with_tone(data, 5e-6))
    white = condition(validation, "whiteness")
    assert "tones of 117.3 Hz" in white.finding and "unbalance" in white.advice
    assert condition(validation, "independence").passed and condition(validation, "ringing").passed
    assert validation.verdict == "validated with reservations", validation.report()


def copied(data: IdentificationData, change: Callable[[np.ndarray], np.ndarray]) -> IdentificationData:
    return replace(data, experiments=tuple(replace(one, outputs=change(one.outputs)) for one in data.experiments))


@pytest.mark.parametrize(
    "change",
    [lambda y: np.round(y, 10), lambda y: y - y.mean(axis=0), lambda y: y + 3e-6],
    ids=["fewer digits", "without means", "another zero"],
)
def test_a_copy_of_the_data_of_the_identification_is_recognised(slow_predictor, change) -> None:
    model, data, _ = slow_predictor
    share = overlap(fingerprint_of(data, noise_of(model, data)), copied(data, change))
    assert share > OVERLAP


@pytest.mark.parametrize("step", [0.0, 0.1e-6, 0.5e-6, 2e-6], ids=["fine", "0.1 um", "0.5 um", "2 um"])
def test_another_record_of_a_coarse_sensor_is_other_data(slow_predictor, step: float) -> None:
    """Single rows of coarse data often have the same values: 78 % of a sensor of 0.5 um with a noise of 0.02 um."""
    model, data, _ = slow_predictor
    random = np.random.default_rng(8)
    other = draw_data(BEARING, random, 10_000, data)[0]
    coarse = [copied(one, lambda y: np.round(y / step) * step if step else y) for one in (data, other)]
    assert overlap(fingerprint_of(coarse[0], noise_of(model, data) + 0.3 * step), coarse[1]) == 0.0


def test_a_sensor_at_rest_that_repeats_itself_is_other_data() -> None:
    """A coarse sensor of a rotor at rest shows two values: stretches of one record are in any other."""
    at_rest = [
        IdentificationData.from_arrays(noise(seed=seed), (noise(seed=10 + seed) > 2.5) * 1e-6, 1e-4) for seed in (1, 2)
    ]
    share = overlap(fingerprint_of(at_rest[0], [3e-7, 3e-7]), at_rest[1])
    assert np.isnan(share) or share == 0.0


def test_data_in_other_units_than_the_model_are_refused(slow_predictor) -> None:
    model, data, _ = slow_predictor
    in_um = replace(copied(data, lambda y: 1e6 * y), output_units=("um", "um"))
    with pytest.raises(IdentificationError, match="the output x_1 is in um in the data and in m in the model"):
        validate(model, in_um)


def test_inputs_that_are_copies_of_one_another_make_no_warning(slow_predictor) -> None:
    model, data, controller = slow_predictor
    (item,) = data.experiments
    twice = replace(data, experiments=(replace(item, inputs=item.inputs[:, [0, 0]]),))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        validation = validate(model, twice, controller)
    assert validation.verdict != "validated" and not condition(validation, "controller").passed


def test_a_loop_with_another_controller_is_said_to_be_another_loop(slow_predictor) -> None:
    model, data, controller = slow_predictor
    other = controller.model_copy(update={"derivative_gain": 0.8 * controller.derivative_gain})
    one = condition(validate(model, data, other), "closed_loop_fit")
    assert not one.passed and "The controller did not compute the recorded currents" in one.advice


def test_motion_that_the_reference_does_not_explain_at_all_is_said_in_words() -> None:
    coherence = Coherence(
        ("x", "y"), np.array([5.0]), np.array([[0.9, 0.0]]), np.array([2e-6, 0.0]), np.array([1e-7, 1e-6]), 10.0
    )
    assert coherence.brief == "noise and distortion together 5 % on x, all of the motion on y"
    assert "inf" not in coherence.summary
