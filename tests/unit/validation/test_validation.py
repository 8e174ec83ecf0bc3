"""Validation: true models pass, wrong ones fail for the right reason, and data that tell nothing are refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.experiments import detrend, merge
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, StateSpaceModel, Validation, identify, validate
from amb_core.identification.validation import nrmse_fit, predict
from amb_core.identification.validation.report import WIDTH
from amb_core.identification.validation.residuals import check_residuals
from amb_core.loop.control import ControllerParameters

CONTROLLER = ControllerParameters()


def test_the_true_model_is_validated(validation: Validation) -> None:
    assert validation.white and validation.independent and validation.closed_loop_stable and validation.validated
    assert validation.fit.min() > 99.0 and validation.one_step_fit.min() > 99.8


def test_residuals_of_the_true_model_have_the_covariance_of_its_innovations(
    validation: Validation, model: StateSpaceModel
) -> None:
    expected = np.sqrt(np.diag(model.innovation_covariance))
    assert validation.residuals.deviation == pytest.approx(expected, rel=0.03)  # 6000 samples: one sigma is 0.9 %


def test_a_model_of_too_low_an_order_fails(data: IdentificationData, model: StateSpaceModel) -> None:
    """Without the actuators' states the first lags of the inputs explain what is missing."""
    low = replace(
        model, a=model.a[:4, :4], b=model.b[:4] + 0.1 * model.b[:4], c=model.c[:, :4], k=model.k[:4],
        initial_state=np.zeros(4),
    )  # fmt: skip
    validation = validate(low, data, CONTROLLER)
    assert not validation.independent and validation.verdict != "validated"
    assert "Raise the order" in " ".join(validation.report().split())


def test_k_steps_ahead_is_the_filtered_state_left_alone(data: IdentificationData, model: StateSpaceModel) -> None:
    short = data.window(0, 400)
    prediction = predict(model, short, (1, 7))
    item = short.experiments[0]
    u, y = item.inputs - model.input_offset, item.outputs
    state, expected = prediction.first_states[0], []
    for step in range(400):
        ahead = state
        for later in range(step, min(step + 6, 400)):
            ahead = model.a @ ahead + model.b @ u[later]
        expected.append(model.c @ ahead)  # of y[step + 6] from outputs before `step`
        state = model.a @ state + model.b @ u[step] + model.k @ (y[step] - model.c @ state)
    spread = np.linalg.norm(y[6:] - y[6:].mean(axis=0), axis=0)
    error = np.linalg.norm(y[6:] - np.array(expected[:-6]), axis=0)
    assert prediction.fit_at(7) == pytest.approx(100.0 * (1.0 - error / spread), abs=1e-6)


def test_predictions_get_worse_with_the_horizon(validation: Validation) -> None:
    fit = [validation.prediction.fit_at(horizon).min() for horizon in (1, 20, 100)]
    assert fit[0] > fit[1] > fit[2]


def test_a_model_with_feedthrough_predicts_what_it_makes() -> None:
    random = np.random.default_rng(0)
    u = random.normal(size=(300, 1))
    y = lfilter([0.5, 0.2], [1.0, -0.8], u, axis=0) + 3.0
    first_order = StateSpaceModel(
        [[0.8]], [[1.0]], [[0.6]], [[0.5]], [[0.1]], [[1e-12]], [0.0], [3.0], [0.0], 1e-3, ("u",), ("y",)
    )  # fmt: skip
    prediction = predict(first_order, IdentificationData.from_arrays(u, y, 1e-3, input_names=["u"], output_names=["y"]))
    assert np.abs(prediction.residuals[0]).max() < 1e-12


def test_the_first_state_of_other_data_is_found(bearing, data: IdentificationData, model: StateSpaceModel) -> None:
    """Amid a square wave the rotor moves: a start at rest would show in the first residuals."""
    amid = data.window(1_010, 3_000)
    residuals = predict(model, amid).residuals[0][:20]
    assert np.abs(residuals).max() < 6.0 * np.sqrt(model.innovation_covariance.max())


def test_data_amid_a_run_are_followed_from_the_start(data: IdentificationData, model: StateSpaceModel) -> None:
    assert validate(model, data.window(1_010, 5_500), CONTROLLER).fit.min() > 99.0


def test_means_are_what_the_deviations_lack(bearing, validation: Validation) -> None:
    """Without its offsets the model does not know that gravity holds the rotor below the reference."""
    loop = validation.closed_loop
    assert loop is not None
    assert loop.fit_without_means[1] < 50.0 < 99.0 < loop.fit[1]
    sag = [record.position[-1] for record in (*loop.simulated, *loop.without_means) if record is not None]
    assert sag[1][1] - sag[0][1] == pytest.approx(-loop.measured[0].position[:, 1].mean(), rel=0.02)


def test_another_load_shows_as_an_offset(data: IdentificationData, model: StateSpaceModel) -> None:
    light = replace(model, input_offset=0.5 * model.input_offset)
    validation = validate(light, data, CONTROLLER)
    assert validation.closed_loop is not None and validation.closed_loop.offset[1] < -10e-6
    assert not validation.validated and "rests elsewhere" in validation.report()


def test_a_gain_that_is_wrong_shows_in_closed_loop_and_frequency_response(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    validation = validate(replace(model, b=1.2 * model.b), data, CONTROLLER)
    assert not validation.validated and validation.verdict == "not validated"
    text = " ".join(validation.report().split())
    assert "FAILED the frequency response agrees" in text and "FAILED gains, dead times" in text


def test_what_matters_little_is_a_reservation(data: IdentificationData, model: StateSpaceModel) -> None:
    """A gain that is off by 1 % hardly shows in closed loop, and clearly in the residuals."""
    validation = validate(replace(model, b=1.01 * model.b), data, CONTROLLER)
    assert validation.validated and not validation.independent
    assert validation.verdict == "validated with reservations"
    assert validation.summary.startswith("validated with reservations: ")


def test_a_loop_that_diverges_is_no_error(data: IdentificationData, model: StateSpaceModel) -> None:
    validation = validate(replace(model, b=-model.b), data, CONTROLLER)
    assert validation.closed_loop_stable is False and not validation.validated
    assert np.all(validation.fit == -np.inf)
    text = json.dumps(validation.as_dict(), allow_nan=False)
    assert json.loads(text)["closed_loop"]["fit_percent"] == [None, None]
    assert "UNSTABLE" in validation.report()


def test_without_controller_or_reference_the_closed_loop_is_left_out(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    alone = replace(data, experiments=tuple(replace(item, reference=None) for item in data.experiments))
    for validation, reason, stable in (
        (validate(model, data), "controller is not known", None),
        (validate(model, alone, CONTROLLER), "no reference", True),
    ):
        assert validation.closed_loop is None and validation.closed_loop_stable is stable and validation.fit.size == 0
        assert validation.verdict == "validated with reservations" and reason in " ".join(validation.report().split())


def test_an_unstable_closed_loop_is_refused_without_a_reference_too(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    alone = replace(data, experiments=tuple(replace(item, reference=None) for item in data.experiments))
    validation = validate(model, alone, ControllerParameters(proportional_gain=100.0))
    assert validation.closed_loop_stable is False and not validation.validated
    assert validation.failed[0].key == "closed_loop" and "UNSTABLE" in validation.report()
    assert validation.summary.startswith("not validated: truth, order 6; closed loop unstable; one-step fit")


@pytest.mark.parametrize("faster", [2e-6, -5e-5])
def test_clocks_that_differ_by_parts_per_million_are_one(
    data: IdentificationData, model: StateSpaceModel, validation: Validation, faster: float
) -> None:
    other = replace(data, sample_time=data.sample_time * (1.0 + faster))
    again = validate(model, other, CONTROLLER.at_rate(other.sample_rate))
    assert again.verdict == validation.verdict and again.fit == pytest.approx(validation.fit, abs=0.01)
    merged = merge([data, other])
    assert merged.samples == 2 * data.samples


def test_sample_times_that_differ_are_refused_with_the_difference(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    other = replace(data, sample_time=data.sample_time * 1.001)
    for refused in (lambda: validate(model, other, CONTROLLER), lambda: merge([data, other])):
        with pytest.raises(IdentificationError, match=r"they differ by 0.1 %; if the times .* are wrong, give --rate"):
            refused()


def test_a_constant_in_the_recorded_currents_does_not_refuse_a_true_model(bearing, model: StateSpaceModel) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6, amplitude=20e-6)
    constant = np.array([1.5, -0.4])
    data = IdentificationData.from_record(record)
    biased = IdentificationData.from_record(replace(record, current=record.current + constant))
    validation = validate(model, data, CONTROLLER)
    again = validate(replace(model, input_offset=model.input_offset + constant), biased, CONTROLLER)
    assert again.verdict == "validated with reservations" and again.fit == pytest.approx(validation.fit, abs=0.01)
    assert "without the constant in the recorded currents, i_x 1.5 A, i_y -0.4 A" in " ".join(again.report().split())
    twice = validate(replace(model, b=1.5 * model.b), biased, CONTROLLER)
    assert not twice.validated, "a wrong model stays one"


def test_nor_does_one_that_the_currents_of_the_identification_lacked(bearing, model: StateSpaceModel) -> None:
    record = bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6, amplitude=20e-6)
    plain = validate(model, IdentificationData.from_record(record), CONTROLLER)
    biased = IdentificationData.from_record(replace(record, current=record.current + np.array([1.5, -0.4])))
    again = validate(model, biased, CONTROLLER)
    assert again.verdict == "validated with reservations" and again.fit == pytest.approx(plain.fit, abs=0.01)
    assert [one.key for one in again.failed] == ["controller"]
    text = " ".join(again.report().split())
    assert "all judged without the constant in the recorded currents, i_x 1.5 A, i_y -0.4 A" in text
    for wrong in (
        replace(model, b=1.2 * model.b),
        replace(model, a=model.a @ model.a),
        replace(model, input_offset=0.5 * model.input_offset),
        replace(model, input_offset=model.input_offset + np.array([0.2, 0.0])),
    ):
        assert not validate(wrong, biased, CONTROLLER).validated, "a wrong model stays one"


def test_experiments_without_reference_are_counted(data: IdentificationData, model: StateSpaceModel) -> None:
    alone = replace(data, experiments=tuple(replace(item, reference=None) for item in data.experiments))
    validation = validate(model, merge([data, alone]), CONTROLLER)
    assert "1 experiment without reference left out" in validation.report()
    assert validation.residuals.samples == 2 * data.samples


def test_detrended_data_give_the_same_verdict(
    data: IdentificationData, model: StateSpaceModel, validation: Validation
) -> None:
    again = validate(model, detrend(data), CONTROLLER)
    assert again.fit == pytest.approx(validation.fit, abs=1e-6)
    assert again.residuals.whiteness.statistic == pytest.approx(validation.residuals.whiteness.statistic, rel=1e-6)


def test_the_report_is_a_page_of_plain_text(validation: Validation) -> None:
    lines = validation.report().splitlines()
    assert len(lines) < 80 and max(map(len, lines)) <= WIDTH
    for part in ("CLOSED LOOP", "PREDICTION", "RESIDUALS", "FREQUENCY", "VERDICT      validated"):
        assert any(line.startswith(part) for line in lines)
    assert any(line.startswith("    standard deviation (m)") for line in lines)
    assert "\n" not in validation.summary and validation.summary.startswith("validated: truth, order 6")


def test_the_numbers_are_strict_json(validation: Validation) -> None:
    values = json.loads(json.dumps(validation.as_dict(), allow_nan=False))
    assert values["validated"] is True
    assert values["closed_loop"]["fit_percent"] == pytest.approx(validation.fit.tolist())
    assert values["residuals"]["whiteness"]["passed"] is True


def with_outputs(data: IdentificationData, outputs: np.ndarray) -> IdentificationData:
    return replace(data, experiments=tuple(replace(item, outputs=outputs) for item in data.experiments))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda data: replace(data, sample_time=2e-4), r"sample time of 0\.0002 s, the model of 0\.0001 s"),
        (lambda data: replace(data, output_names=("x", "z")), "the data have the outputs x, z, the model x, y"),
        (lambda data: data.window(0, 220), "220 samples are too few to test residuals over 25 lags"),
        (lambda data: with_outputs(data, np.full((6_000, 2), np.nan)), "experiment 0 holds values that are not finite"),
        (lambda data: with_outputs(data, np.zeros((6_000, 2))), "output 1 is constant"),
    ],
)
def test_data_that_do_not_fit_are_refused(
    data: IdentificationData,
    model: StateSpaceModel,
    change: Callable[[IdentificationData], IdentificationData],
    reason: str,
) -> None:
    with pytest.raises(IdentificationError, match=reason):
        validate(model, change(data), CONTROLLER)


def test_horizons_are_those_that_the_shortest_experiment_allows_unless_they_are_given(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    short = replace(
        data.window(0, 260), experiments=(*data.window(0, 260).experiments, *data.window(300, 450).experiments)
    )
    assert validate(model, short, CONTROLLER).horizons == (1, 5, 20)
    with pytest.raises(IdentificationError, match="horizons from 1 to 100 steps are not allowed"):
        validate(model, short, CONTROLLER, horizons=(1, 100))


def test_a_model_without_stable_predictor_is_refused(data: IdentificationData, model: StateSpaceModel) -> None:
    with pytest.raises(IdentificationError, match=r"predictor of the model is unstable \(spectral radius"):
        validate(replace(model, k=1e-6 * model.k), data, CONTROLLER)


def test_a_controller_of_another_rate_is_refused(data: IdentificationData, model: StateSpaceModel) -> None:
    with pytest.raises(IdentificationError, match="must have one sample time"):
        validate(model, data, ControllerParameters(sample_rate=20_000.0))


@pytest.mark.parametrize("pole", [3.0, 1e4])
def test_a_model_with_a_pole_far_outside_is_not_validated_and_its_predictions_stay_numbers(pole: float) -> None:
    random = np.random.default_rng(0)
    data = IdentificationData.from_arrays(random.normal(size=(2_000, 2)), random.normal(size=(2_000, 2)), 1e-4)
    a, zero = np.diag([0.5, pole]), np.zeros(2)
    far = StateSpaceModel(
        a, np.eye(2), np.eye(2), np.zeros((2, 2)), a - 0.1 * np.eye(2), np.eye(2), zero, zero, zero, 1e-4,
        input_names=data.input_names, output_names=data.output_names,
        input_units=data.input_units, output_units=data.output_units,
    )  # fmt: skip
    validation = validate(far, data)
    assert not validation.validated
    assert np.isfinite(validation.prediction.fit).all()


def test_identify_and_validate_give_a_constant_output_the_same_number(
    data: IdentificationData, model: StateSpaceModel
) -> None:
    (item,) = data.experiments
    still = replace(data, experiments=(replace(item, outputs=item.outputs * [1.0, 0.0]),))
    for attempt in (
        lambda: identify(still, 4, "ssarx"),
        lambda: validate(model, still),
        lambda: nrmse_fit(still.experiments[0].outputs, still.experiments[0].outputs),
    ):
        with pytest.raises(IdentificationError, match="output 2 is constant"):
            attempt()
    with pytest.raises(IdentificationError, match="residual 2 is constant"):
        check_residuals([item.outputs * [1.0, 0.0]], [item.inputs])
