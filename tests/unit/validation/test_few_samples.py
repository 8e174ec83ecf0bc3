"""What a model is measured by comes from the data: no model lowers it, least of all one from few samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import lfilter, ss2tf

from amb_core.identification import IdentificationData, StateSpaceModel, Validation, compare, identify, validate
from amb_core.identification.validation import Condition, Verdict
from amb_core.identification.validation.deviations import Deviation
from amb_core.identification.validation.model_error import BandError
from amb_core.identification.validation.possible import possible_fit
from amb_core.linear import LinearSystem
from amb_core.linear.sampling import discretised
from amb_core.loop.records import LoopRecord
from tests.benchmarks.verdicts.bearings import Bearing, draw_bearing, draw_data, model_in_innovations_form, named

FEW = 300
SEEDS = (3, 5, 8, 9)


def condition(validation: Validation, key: str) -> Condition:
    (one,) = (one for one in validation.conditions if one.key == key)
    return one


@pytest.fixture(scope="module", params=SEEDS)
def drawn(request: pytest.FixtureRequest) -> tuple[Bearing, IdentificationData, IdentificationData]:
    """A bearing of one to four axes, and two experiments of it."""
    random = np.random.default_rng([40, request.param])
    bearing = draw_bearing(random)
    return bearing, draw_data(bearing, random, 6_000)[0], draw_data(bearing, random, 6_000)[0]


def of_few_samples(model: StateSpaceModel) -> StateSpaceModel:
    return replace(model, samples=FEW, method="ssarx")


def late(true: StateSpaceModel) -> StateSpaceModel:
    """The inputs act three samples later."""
    model = true
    for _ in range(3):
        n, axes = model.order, model.inputs
        a = block_diag(model.a, np.zeros((axes, axes)))
        a[:n, n:] = model.b
        model = replace(
            model, a=a, b=np.vstack([np.zeros((n, axes)), np.eye(axes)]),
            c=np.hstack([model.c, np.zeros((model.outputs, axes))]),
            k=np.vstack([model.k, np.zeros((axes, model.outputs))]), initial_state=np.zeros(n + axes),
        )  # fmt: skip
    return model


def hardly_responding(true: StateSpaceModel) -> StateSpaceModel:
    """A stable model whose outputs are nearly their own noise."""
    n = true.outputs
    return named(replace(
        true, a=0.9 * np.eye(n), b=0.1 * np.abs(true.c @ true.b).mean() * np.eye(n), c=np.eye(n), k=0.8 * np.eye(n),
        initial_state=np.zeros(n),
    ))  # fmt: skip


WRONG = {
    "half the gain": lambda bearing: model_in_innovations_form(bearing.loop(np.full(bearing.axes, 0.5))),
    "twice the gain": lambda bearing: model_in_innovations_form(bearing.loop(np.full(bearing.axes, 2.0))),
    "wrong sign": lambda bearing: replace(bearing.true_model(), b=-bearing.true_model().b),
    "late": lambda bearing: late(bearing.true_model()),
    "no unstable pole": lambda bearing: hardly_responding(bearing.true_model()),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_model_is_refused_however_few_samples_it_comes_from(
    drawn: tuple[Bearing, IdentificationData, IdentificationData], fault: str
) -> None:
    bearing, data, _ = drawn
    validation = validate(of_few_samples(WRONG[fault](bearing)), data, bearing.controller)
    assert validation.verdict == "not validated", validation.report()
    assert len(validation.band_errors) > 5 and "say nothing" not in validation.report()


def test_the_fit_that_the_data_allow_is_that_of_the_true_model_and_the_same_for_every_model(
    drawn: tuple[Bearing, IdentificationData, IdentificationData],
) -> None:
    bearing, data, _ = drawn
    true = validate(bearing.true_model(), data, bearing.controller)
    assert true.possible_fit is not None and true.possible_fit.fit == pytest.approx(true.fit, abs=1.5)
    for wrong in WRONG.values():
        of_wrong = validate(of_few_samples(wrong(bearing)), data, bearing.controller).possible_fit
        assert of_wrong is not None and np.array_equal(of_wrong.fit, true.possible_fit.fit)


@pytest.mark.parametrize("rate", [10_000.0, 100_000.0])
def test_the_fit_that_the_data_allow_does_not_depend_on_the_sample_rate(rate: float) -> None:
    """A loop of 90 Hz with noise on its sensor: a true model leaves the noise alone."""
    random, steps = np.random.default_rng(2), round(2.0 * rate)
    a, b = np.array([[0.0, 1.0], [-3e5, -400.0]]), np.array([[0.0], [3e5]])
    sampled = discretised(LinearSystem(a, b, np.eye(1, 2), np.zeros((1, 1)), 0.0), 1.0 / rate)
    tones = np.arange(1.0, 300.0, 0.5)
    time = np.arange(steps)[:, np.newaxis] / rate
    reference = np.cos(2.0 * np.pi * tones * time + random.uniform(0.0, 2.0 * np.pi, len(tones))).sum(axis=1)
    moved = lfilter(*tf_of(sampled), reference)
    noise = 0.3 * moved.std() * random.standard_normal(steps)
    position = (moved + noise)[:, np.newaxis]
    record = LoopRecord(0, 1.0 / rate, reference[:, np.newaxis], position, np.zeros_like(position), ("x",))
    possible = possible_fit([record])
    assert possible is not None
    assert possible.fit[0] == pytest.approx(100.0 * (1.0 - noise.std() / position.std()), abs=1.0)


def tf_of(system: LinearSystem) -> tuple[np.ndarray, np.ndarray]:
    numerator, denominator = ss2tf(system.a, system.b, system.c, system.d)
    return numerator[0], denominator


def test_a_true_model_stays_validated_whatever_number_of_samples_it_names(
    drawn: tuple[Bearing, IdentificationData, IdentificationData],
) -> None:
    bearing, data, _ = drawn
    for samples in (FEW, 100_000):
        model = replace(bearing.true_model(), samples=samples, method="ssarx", fingerprint=np.array([1.0] * 20))
        assert [one.level for one in validate(model, data, bearing.controller).failed if one.key != "distortion"] == []


@pytest.fixture(scope="module")
def of_methods(bearing) -> tuple[dict[str, StateSpaceModel], IdentificationData]:
    """Models of the linear bearing from 300 samples by three methods and one from 6000, and other data."""
    noise = {"noise": 3e-7, "force": 1.0, "frequency": 40.0, "amplitude": 5e-6}
    data = IdentificationData.from_record(bearing.experiment(duration=0.6, **noise))
    judged = IdentificationData.from_record(bearing.experiment(duration=0.6, **{**noise, "noise": 3.1e-7}))
    models = {
        f"{method} of few": identify(data.window(0, FEW), 4, method).model for method in ("ssarx", "pbsid", "cva")
    }
    return models | {"pem of many": identify(data, 6).model}, judged


def test_models_of_every_method_from_few_samples_are_refused_and_never_rank_first(of_methods) -> None:
    models, data = of_methods
    comparison = compare(models, data, "paper")
    assert next(iter(comparison.validations)) == "pem of many"
    for name, validation in comparison.validations.items():
        assert validation.validated == (name == "pem of many"), validation.report()


def test_the_few_samples_of_a_model_are_named_as_the_cause_of_an_error_that_their_noise_explains(of_methods) -> None:
    models, data = of_methods
    named_so = [
        one
        for name, model in models.items()
        if name != "pem of many"
        for one in validate(model, data, "paper").failed
        if one.key in ("response", "deviations") and f"estimated from {FEW} samples" in one.advice
    ]
    assert named_so and all(one.level is Verdict.NOT_VALIDATED for one in named_so)


@pytest.mark.parametrize(("size", "p_estimated", "level"), [
    (0.5, 0.2, Verdict.VALIDATED),
    (0.5, 1e-9, Verdict.RESERVATIONS),
    (2.0, 0.2, Verdict.NOT_VALIDATED),
    (2.0, 1e-9, Verdict.NOT_VALIDATED),
])  # fmt: skip
def test_the_noise_of_few_samples_excuses_what_is_significant_and_small_and_nothing_that_matters(
    validation: Validation, size: float, p_estimated: float, level: Verdict
) -> None:
    kind = Deviation("gain of i_x", "%", 10.0 * size, 0.1, size, 1e-9, p_estimated)
    band = BandError(100.0, 112.0, "i_x", 5.0 * size, 0.1, 5.0, 1e-9, p_estimated)
    one = replace(validation, deviations=(kind,), band_errors=(band,), model=of_few_samples(validation.model))
    for key in ("deviations", "response"):
        found = condition(one, key)
        assert found.level is level
        assert (f"estimated from {FEW} samples" in found.advice) == (size > 1.0 and p_estimated > 0.1)
