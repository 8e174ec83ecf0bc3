"""Models of plants that respond within the sample: D is estimated where asked for, and zero otherwise."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from amb_core.data.experiments.checks import Severity
from amb_core.ground.errors import IdentificationError
from amb_core.identification import (
    METHODS,
    IdentificationData,
    identify,
    select_order,
    validate,
)
from amb_core.identification.estimate.arx import arx
from amb_core.identification.estimate.methods import estimate
from amb_core.identification.progress import Watch
from amb_core.identification.uncertainty import ModelUncertainty
from tests.linear_process import LinearProcess, response

PROCESS = LinearProcess(3, 2, feedthrough=True)


@functools.cache
def data() -> IdentificationData:
    return PROCESS.data()


@functools.cache
def uncertainty() -> ModelUncertainty:
    identification = identify(data(), 6, feedthrough=True).uncertainty
    assert identification is not None
    return identification


@pytest.mark.parametrize("method", METHODS)
def test_every_method_estimates_it_where_asked_for(method: str) -> None:
    models = estimate(data(), 6, method, Watch(), "process", feedthrough=True)
    assert min(map(PROCESS.response_error, models)) < 0.03
    assert min(float(np.abs(model.d - PROCESS.model.d).max()) for model in models) < 0.2


@pytest.mark.parametrize("method", METHODS)
def test_it_is_zero_where_not_asked_for(method: str) -> None:
    models = estimate(data(), 6, method, Watch(), "process")
    assert not any(model.d.any() for model in models)
    assert min(map(PROCESS.response_error, models)) > 0.2


def test_a_long_autoregressive_model_has_it_too() -> None:
    item = data().experiments[0]
    model = arx(item.inputs, item.outputs, 0.5, 20, feedthrough=True)
    assert PROCESS.response_error(model) < 0.1
    assert np.abs(model.d - PROCESS.model.d).max() < 0.2


def test_the_order_is_found_with_it() -> None:
    assert select_order(data(), range(4, 9), feedthrough=True).chosen == 6


def test_its_deviations_are_those_of_the_estimates_errors() -> None:
    """Chi-square of the response's errors in all entries and at all frequencies, and of D alone."""
    within = uncertainty().response(np.linspace(0.01, 0.9, 60))
    reached = response_at(uncertainty(), within.frequency)
    error = np.abs(within.response - reached)
    deviation = np.hypot(within.magnitude_deviation, within.magnitude * within.phase_deviation)
    assert 0.5 < np.sqrt(np.mean((error / deviation) ** 2)) < 1.6
    of_d = uncertainty().deviations.d
    assert of_d is not None
    ratio = (uncertainty().model.d - PROCESS.model.d) / np.linalg.norm(of_d, axis=0)
    assert 0.3 < np.sqrt(np.mean(ratio**2)) < 2.0


def response_at(_: ModelUncertainty, frequency: np.ndarray) -> np.ndarray:
    true = PROCESS.model
    z = np.exp(2j * np.pi * frequency * true.sample_time)
    return np.array([true.c @ np.linalg.solve(one * np.eye(true.order) - true.a, true.b) + true.d for one in z])


def test_models_drawn_from_its_distribution_lie_about_the_estimate() -> None:
    drawn = uncertainty().samples(20)
    spread = np.std([model.d for model in drawn], axis=0)
    of_d = uncertainty().deviations.d
    assert of_d is not None
    assert spread == pytest.approx(np.linalg.norm(of_d, axis=0), rel=0.6)
    assert max(map(PROCESS.response_error, drawn)) < 0.06
    assert response(drawn[0]).shape == (60, 2, 3)


def test_the_residuals_of_the_estimate_pass_their_tests_on_other_data() -> None:
    validation = validate(uncertainty().model, PROCESS.data(seed=2))
    assert validation.white and validation.independent and validation.validated


def test_the_check_of_the_delay_advises_it_and_is_content_with_it() -> None:
    plain, direct = (
        identify(data(), 6, "ssarx", feedthrough=wanted).report.finding("delay") for wanted in (False, True)
    )
    assert plain.severity is Severity.WARNING and "identify with --feedthrough" in plain.advice
    assert direct.severity is Severity.INFO and "direct feedthrough" in direct.what


def test_a_model_keeps_it_in_every_kind_of_file(tmp_path) -> None:
    model = uncertainty().model
    for ending in ("json", "npz", "mat"):
        model.save(tmp_path / f"model.{ending}")
        assert (type(model).load(tmp_path / f"model.{ending}").d == model.d).all()


def test_the_bearings_loop_refuses_it(bearing) -> None:
    with pytest.raises(IdentificationError, match=r"^feedthrough is not allowed for data of the bearing's loop: "):
        identify(bearing.experiment(2e-8, duration=0.4), 6, feedthrough=True)
