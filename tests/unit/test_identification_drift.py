"""Identification under drift of the sensors: found whatever its shape, removed, and no change of clean data."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.data.experiments import Severity, check_data, cure_drift, high_pass
from amb_core.data.experiments.drift import find_drift
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, identify, pem, validate
from amb_core.identification.estimate.methods import estimate
from amb_core.identification.progress import IdentificationProgress, Watch
from amb_core.identification.uncertainty import estimate_uncertainty
from amb_core.linear.model.state_space import StateSpaceModel

SHAPES = ("ramp", "sine", "half sine", "warm-up", "random walk", "step")
LOOP = {"noise": 5e-8, "force": 0.3, "frequency": 10.0, "duration": 1.0}


def drifting(bearing, shape: str) -> IdentificationData:
    """10 000 samples of squares on x, then on y, with noise, and with a drift of the sensors."""
    return IdentificationData.from_record(bearing.experiment(drift=shape, **LOOP))


@pytest.mark.parametrize("shape", SHAPES)
def test_drift_is_found_whatever_its_shape(bearing, shape: str) -> None:
    finding = check_data(drifting(bearing, shape), 6).finding("drift")
    assert finding.severity is Severity.WARNING and finding.where == "x, y"
    assert "pole near 1" in finding.what


def test_data_without_drift_are_identified_as_without_the_check(bearing) -> None:
    data = drifting(bearing, "")
    assert check_data(data, 6).finding("drift").severity is Severity.INFO and cure_drift(data) is None
    ours, plain = (identify(data, 6, "ssarx", drift=option) for option in ("auto", "none"))
    assert ours.drift is None
    for name in ("a", "b", "c", "k", "input_offset", "output_offset", "initial_state", "innovation_covariance", "fit"):
        assert np.array_equal(getattr(ours.model, name), getattr(plain.model, name))


@pytest.mark.parametrize("shape", ["sine", "step"])
def test_a_model_of_drifting_data_is_as_good_as_one_without_drift(bearing, shape: str) -> None:
    clean = bearing.response_error(identify(drifting(bearing, ""), 6).model)
    result = identify(drifting(bearing, shape), 6)
    assert len(result.model.unstable_poles()) == 2 and result.stable
    assert bearing.response_error(result.model) < 1.5 * clean
    assert "drift removed" in result.summary
    left = identify(drifting(bearing, shape), 6, drift="none")
    assert bearing.response_error(left.model) > 1.5 * clean, "the drift matters"


def test_a_search_that_stalls_above_the_minimum_is_made_again_from_another_start() -> None:
    """From `ssarx` alone, a mode of the predictor goes to the limit of stability: 1.6 times the error without drift."""
    from tests.benchmarks.regions import drift_cases

    case = drift_cases.Case("flexible", "squares", "random_walk", 0)
    known, told = drift_cases.bearing(case.bearing), list[IdentificationProgress]()
    cure, watch = cure_drift(IdentificationData.from_record(drift_cases.record(case))), Watch(told.append)
    assert cure is not None
    (model,) = estimate(cure.data, known.order, "pem", watch, "")
    assert watch.search is not None and watch.search.converged
    assert np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))) < 0.998
    error = drift_cases.response_of(model.a, model.b, model.c) - known.response
    size = np.linalg.norm(known.response, axis=(1, 2), ord=2)
    without_drift = 0.0156  # of the same case without drift
    assert np.max(np.linalg.norm(error, axis=(1, 2), ord=2) / size) < 1.1 * without_drift
    search = [now for now in told if now.stage == "pem"]
    assert all(now.done <= now.total for now in search)
    costs = [now.cost for now in search if now.cost is not None]
    assert costs == sorted(costs, reverse=True), "the second search reports the least cost so far"


def test_a_step_is_found_where_it_is_and_by_its_size(bearing) -> None:
    cure = cure_drift(drifting(bearing, "step"))
    assert cure is not None and [step.step for step in cure.steps] == [6_000]
    assert cure.steps[0].size == pytest.approx([4e-6, -2.5e-6], abs=0.2e-6)


def test_the_model_keeps_the_operating_point(bearing) -> None:
    data = drifting(bearing, "ramp")
    model = identify(data, 6, "ssarx").model
    assert model.output_offset == pytest.approx(data.experiments[0].outputs.mean(axis=0), abs=1e-12)
    assert model.input_offset == pytest.approx(data.experiments[0].inputs.mean(axis=0), abs=1e-9)


def test_filtered_data_obey_the_equations_of_the_plant(bearing) -> None:
    """Without noise the response of the plant to the filtered inputs is the filtered output, from some first state."""
    model, steps = bearing.model, 300
    inputs = np.random.default_rng(1).normal(size=(steps, 2))
    state, outputs = np.full(6, 1e-6), np.empty((steps, 2))
    for step, current in enumerate(inputs):
        outputs[step], state = model.c @ state, model.a @ state + model.b @ current
    item = high_pass(IdentificationData.from_arrays(inputs, outputs, 1e-4), 201).experiments[0]
    assert item.steps == 100 and item.first_step == 100
    free = np.vstack([model.c @ np.linalg.matrix_power(model.a, step) for step in range(20)])
    forced, state = np.empty((20, 2)), np.zeros(6)
    for step in range(20):
        forced[step], state = model.c @ state, model.a @ state + model.b @ item.inputs[step]
    offset = np.tile(np.eye(2), (20, 1))  # a constant less the mean
    rest = (item.outputs[:20] - forced).reshape(-1)
    columns = np.hstack([free, offset])
    solution = np.linalg.lstsq(columns, rest, rcond=None)[0]
    assert np.linalg.norm(rest - columns @ solution) < 1e-9 * np.linalg.norm(rest)


def test_short_data_are_not_checked(bearing) -> None:
    short = drifting(bearing, "ramp").window(0, 900)
    assert find_drift(short) is None and cure_drift(short) is None
    assert "not checked" in check_data(short, 6).finding("drift").what


def test_an_unknown_option_is_refused(bearing) -> None:
    with pytest.raises(IdentificationError, match=r"unknown drift 'all'; allowed: auto, none, prefilter"):
        identify(drifting(bearing, ""), 6, drift="all")  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match=r"a moving average of 4 samples is not allowed; .* odd"):
        high_pass(drifting(bearing, ""), 4)


def test_a_pole_whose_interval_holds_1_is_reported() -> None:
    """Two integrators under feedback: the data do not decide between stable, integrating and unstable."""
    random, steps = np.random.default_rng(5), 3_000
    inputs, outputs, state = np.empty((steps, 2)), np.empty((steps, 2)), np.zeros(2)
    for step in range(steps):
        outputs[step] = state + 0.01 * random.normal(size=2)
        inputs[step] = -0.3 * outputs[step] + random.normal(size=2)
        state = state + inputs[step] * [1.0, 0.8] + 0.01 * random.normal(size=2)
    zero = np.zeros(2)
    start = StateSpaceModel(
        np.diag([0.99, 1.01]), np.diag([1.0, 0.8]), np.eye(2), np.zeros((2, 2)), 0.6 * np.eye(2), np.eye(2),
        zero, zero, zero, 1e-3, ("u1", "u2"), ("y1", "y2"), input_units=("", ""), output_units=("", ""),
    )  # fmt: skip
    data = IdentificationData.from_arrays(inputs, outputs, 1e-3)
    model = pem(inputs, outputs, start)
    uncertainty = estimate_uncertainty(
        StateSpaceModel(
            model.a, model.b, model.c, model.d, model.k, model.innovation_covariance, model.input_offset,
            model.output_offset, model.initial_state, 1e-3, ("u1", "u2"), ("y1", "y2"),
            input_units=("", ""), output_units=("", ""),
        ),
        data,
    )  # fmt: skip
    assert len(uncertainty.poles_at_one) == 2
    assert "holds 1" in uncertainty.summary
    assert any("holds 1" in one.finding for one in validate(uncertainty.model, data, uncertainty=uncertainty).failed)
