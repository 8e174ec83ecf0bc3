"""Slow drift of the sensors is taken out before anything is judged, named, and never taken for another bearing."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from amb_core.data.experiments import IdentificationData, merge
from amb_core.identification import StateSpaceModel, Validation, identify, validate
from amb_core.identification.validation import drift
from amb_core.identification.validation.verdict import Verdict
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from tests.sensor_loop import SensorLoop, with_wrong_gain

SECONDS = 2.0
TIME = np.arange(round(1e4 * SECONDS))[:, np.newaxis] / 1e4  # s
SLOW = 2.0 * np.pi * 0.07 * TIME
SHAPES = {
    "sine of 0.2 um": 0.2e-6 * np.sin(SLOW),
    "sine of 2 um": 2e-6 * np.sin(SLOW),
    "cosine of 2 um": 2e-6 * np.cos(SLOW),
    "ramp of 1 um": 1e-6 * TIME / SECONDS,
    "step of 2 um": np.where(TIME > 1.0, 2e-6, 0.0),
}


def of_axes(shape: str, axes: int) -> np.ndarray:
    """A drift (m), a little less and of the other sign on the second axis."""
    return SHAPES[shape] * np.array([1.0, -0.7])[:axes]


def judged(loop: SensorLoop, model: StateSpaceModel, shape: str, seed: int = 2) -> Validation:
    return validate(model, loop.data(SECONDS, seed=seed, drift=of_axes(shape, loop.axes)), loop.controller)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_true_model_is_validated_with_the_drift_as_its_only_reservation(shape: str, axes: int) -> None:
    loop = SensorLoop(axes)
    validation = judged(loop, loop.model, shape)
    assert validation.verdict is Verdict.RESERVATIONS
    (condition,) = validation.failed
    assert condition.key == "samples" and "slow drift by about" in condition.finding
    assert "was removed from all signals" in condition.finding and "warmed up" in condition.advice
    assert "slow drift" in validation.report()


@pytest.mark.parametrize(
    ("axes", "factor", "shape"), [*((1, 1.1, shape) for shape in SHAPES), (2, 0.9, "cosine of 2 um")]
)
def test_a_wrong_gain_is_refused_on_drifting_data(axes: int, factor: float, shape: str) -> None:
    loop = SensorLoop(axes)
    validation = judged(loop, with_wrong_gain(loop.model, factor), shape)
    assert validation.verdict is Verdict.NOT_VALIDATED
    assert any(one.key == "deviations" and "gain of" in one.finding for one in validation.failed)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_wrong_stiffness_is_refused_on_drifting_data(shape: str) -> None:
    loop = SensorLoop()
    validation = judged(loop, replace(SensorLoop(stiffer=1.1).model, k=loop.model.k), shape)
    assert validation.verdict is Verdict.NOT_VALIDATED
    assert any(one.key == "deviations" and "stiffness of x: -" in one.finding for one in validation.failed)


def test_a_model_identified_from_drifting_data_is_validated_on_others() -> None:
    loop = SensorLoop()
    model = identify(loop.data(SECONDS, drift=of_axes("sine of 2 um", 1)), 3, controller=loop.controller).model
    validation = judged(loop, model, "cosine of 2 um")
    assert validation.validated
    assert {one.key for one in validation.failed} <= {"samples", "whiteness", "independence"}


@pytest.mark.parametrize("axes", [1, 2])
def test_data_without_drift_are_judged_bit_for_bit_as_without_looking_for_it(
    axes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = SensorLoop(axes)
    module, found = sys.modules["amb_core.identification.validation.validate"], []
    for look in (drift.undrifted, lambda _data: None):
        monkeypatch.setattr(module, "undrifted", look)
        found.append(validate(loop.model, loop.data(SECONDS, seed=3), loop.controller))
    ours, plain = found
    assert ours.as_dict() == plain.as_dict()
    assert np.array_equal(ours.prediction.residuals[0], plain.prediction.residuals[0])


def test_drift_under_currents_at_their_limit_is_no_fault_of_the_model() -> None:
    loop = SensorLoop()
    controller = LinearControl(loop.controller.model, LinearControllerParameters(current_limit=0.4))
    record = loop.record(SECONDS, seed=2, drift=of_axes("cosine of 2 um", 1), limit=0.4)
    assert np.mean(np.abs(record.current) >= 0.4) > 0.005
    assert validate(loop.model, IdentificationData.from_record(record), controller).validated


def test_experiments_between_which_the_sensor_drifted_on_are_judged_each_at_its_own_level() -> None:
    loop = SensorLoop()
    ramp = of_axes("ramp of 1 um", 1)
    data = merge([loop.data(SECONDS, seed=seed, drift=ramp + level) for seed, level in ((2, 0.0), (3, 1e-6))])
    assert [one.key for one in validate(loop.model, data, loop.controller).failed] == ["samples"]


def test_another_operating_point_than_drift_explains_is_refused() -> None:
    loop = SensorLoop()
    elsewhere = replace(loop.model, output_offset=loop.model.output_offset + 5e-6)
    validation = judged(loop, elsewhere, "ramp of 1 um")
    assert validation.verdict is Verdict.NOT_VALIDATED
    assert any("rests elsewhere" in one.advice for one in validation.failed)


def test_a_model_without_static_gain_keeps_the_means_of_the_data() -> None:
    loop = SensorLoop()
    integrating = replace(loop.model, a=np.eye(3))
    data = loop.data(0.2)
    assert drift.levelled(data, integrating, np.array([1e-6])) is data
