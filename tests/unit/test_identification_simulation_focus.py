"""Simulation focus: what it gains where the order is too low, that it never loses, derivatives, and what it refuses."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.data.experiments import merge
from amb_core.ground.errors import IdentificationError
from amb_core.identification import (
    IdentificationData,
    StateSpaceModel,
    closed_loop_poles,
    nrmse_fit,
    pem,
    simulate_closed_loop,
    ssarx,
)
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.identification.focus.focus import focus_simulation
from amb_core.identification.focus.problem import SimulationProblem
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord

if TYPE_CHECKING:
    from amb_core.identification import IdentificationProgress
    from conftest import LinearBearing

PAPER = ControllerParameters()
NOISE = {"noise": 5e-8, "force": 0.3}  # m, N
LIMIT = 2.0  # A, below what the multisine asks for
BAND = {"kind": "multisine", "amplitude": 20e-6, "frequency_start": 1.0, "frequency_end": 1_000.0}


@functools.cache
def started(bearing: LinearBearing, order: int) -> tuple[LoopRecord, StateSpaceModel]:
    """A band-limited experiment and the model that PEM finds from it."""
    record = bearing.experiment(duration=0.5, **NOISE, **BAND)
    start = ssarx(record.current, record.position, record.sample_time, order, past=20, future=8)
    return record, pem(record.current, record.position, start)


def fit(model: StateSpaceModel, record: LoopRecord, controller: ControllerParameters = PAPER) -> np.ndarray:
    """Closed-loop fit of both positions (percent)."""
    simulation = simulate_closed_loop(model, controller, record.reference)
    return nrmse_fit(record.position, simulation.position)


def radius(matrix: np.ndarray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def test_a_model_of_too_low_an_order_follows_the_loop_better_on_other_data_too(bearing: LinearBearing) -> None:
    record, start = started(bearing, 4)
    model = focus_simulation(start, IdentificationData.from_record(record), PAPER)
    other = bearing.experiment(**NOISE)
    assert np.all(100.0 - fit(model, record) < 0.8 * (100.0 - fit(start, record)))
    assert np.all(fit(model, other) > fit(start, other))
    assert len(model.unstable_poles()) == 2
    assert model.method == "pem, simulation focus"


def test_a_model_of_the_right_order_stays_as_good_as_it_was(bearing: LinearBearing) -> None:
    record, start = started(bearing, 6)
    model = focus_simulation(start, IdentificationData.from_record(record), PAPER)
    assert np.sum((100.0 - fit(model, record)) ** 2) <= np.sum((100.0 - fit(start, record)) ** 2)
    # K is found anew: its predictions are next to those of PEM, which has the best ones.
    sizes = [np.sqrt(np.diag(one.innovation_covariance)) for one in (start, model)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.01)


def test_closed_loop_and_predictor_are_stable(bearing: LinearBearing) -> None:
    record, start = started(bearing, 4)
    model = focus_simulation(start, IdentificationData.from_record(record), PAPER, most_iterations=3)
    assert np.abs(closed_loop_poles(model, PAPER)[0]) < 1.0
    assert radius(model.a - model.k @ model.c) < 1.0


@pytest.mark.parametrize("limit", [100.0, 2.5], ids=["linear", "limited"])
def test_the_loop_without_noise_is_found_again_from_a_wrong_start(bearing: LinearBearing, limit: float) -> None:
    # With 2.5 A a current meets its limit at every edge of the squares.
    controller = ControllerParameters(current_limit=limit)
    record = bearing.experiment(noise=0.0, duration=0.4, controller=controller)
    assert np.any(np.abs(record.current) == limit) == (limit == 2.5)
    start = _with_gain(replace(bearing.model, b=bearing.model.b * [1.1, 0.9]))
    assert np.all(fit(start, record, controller) < 99.0)
    model = focus_simulation(start, IdentificationData.from_record(record), controller)
    assert np.all(fit(model, record, controller) > 99.9)


def test_a_wrong_offset_is_put_right_where_it_is_free(bearing: LinearBearing) -> None:
    record = bearing.experiment(noise=1e-8, duration=0.4)
    start = _with_gain(replace(bearing.model, output_offset=np.array([1e-6, -2e-6])))
    data = IdentificationData.from_record(record)
    free = focus_simulation(start, data, PAPER, free_offset=True)
    held = focus_simulation(start, data, PAPER, most_iterations=3)
    assert free.output_offset == pytest.approx(np.zeros(2), abs=1e-8)
    assert np.all(held.output_offset == start.output_offset)
    assert np.all(fit(free, record) > 99.9)
    assert np.all(fit(held, record) < 99.7)


def test_every_experiment_has_an_initial_state_of_its_own_and_those_without_reference_are_left_out(
    bearing: LinearBearing,
) -> None:
    record, start = started(bearing, 4)
    parts = [IdentificationData.from_record(record.window(first, 2_000)) for first in (0, 3_000)]
    unknown = IdentificationData.from_arrays(
        record.current, record.position, record.sample_time,
        input_names=("i_x", "i_y"), output_names=("x", "y"), input_units=("A", "A"), output_units=("m", "m"),
    )  # fmt: skip
    problem = SimulationProblem(start, merge([*parts, unknown]), PAPER, False)
    assert problem.samples == 4_000
    assert problem.start.initial_states.shape == (2, 4)
    model = focus_simulation(start, merge([*parts, unknown]), PAPER, most_iterations=5)
    assert model.samples == 4_000
    assert np.all(fit(model, record) > fit(start, record))


@pytest.mark.parametrize(
    "controller",
    [
        ControllerParameters(current_limit=LIMIT),
        ControllerParameters(derivative_filter=3e-4, derivative_on="measurement"),
    ],
    ids=["limited", "filtered"],
)
@pytest.mark.parametrize("first_step", [0, 200])
def test_the_derivatives_are_those_of_the_errors(
    bearing: LinearBearing, controller: ControllerParameters, first_step: int
) -> None:
    whole, start = started(bearing, 4)
    record = whole.window(first_step, 400)
    problem = SimulationProblem(start, IdentificationData.from_record(record), controller, True)
    loop = problem.start
    assert _limited(loop.model, record, controller) == (controller.current_limit < PAPER.current_limit)
    sensitivity, errors = problem.linearise(loop)
    assert np.sum(errors**2) == pytest.approx(problem.squares(loop), rel=1e-9)
    for index, slope in enumerate(-2.0 * sensitivity.T @ errors):
        size = np.linalg.norm(sensitivity[:, index])
        change = np.zeros(sensitivity.shape[1])
        change[index] = 1e-4 / size
        up, down = (problem.squares(problem.move(loop, sign * change)) for sign in (1.0, -1.0))
        assert slope / size == pytest.approx((up - down) / 2e-4, rel=1e-3, abs=1e-3 * np.linalg.norm(errors))


def test_progress_tells_the_mean_square_that_never_grows(bearing: LinearBearing) -> None:
    record, start = started(bearing, 4)
    told: list[IdentificationProgress] = []
    focus_simulation(start, IdentificationData.from_record(record), PAPER, told.append, most_iterations=4)
    assert [item.done for item in told] == [0, 1, 2, 3]
    assert {(item.stage, item.total) for item in told} == {("simulation focus", 4)}
    costs = [item.cost or 0.0 for item in told]
    assert np.all(np.diff(costs) <= 0.0)
    assert costs[0] == pytest.approx(np.sum((1.0 - fit(start, record) / 100.0) ** 2), rel=1e-2)


def test_it_can_be_called_off(bearing: LinearBearing) -> None:
    record, start = started(bearing, 4)
    with pytest.raises(IdentificationError, match="identification cancelled in simulation focus"):
        focus_simulation(start, IdentificationData.from_record(record), PAPER, cancelled=lambda: True)


def test_what_does_not_suit_is_refused(bearing: LinearBearing) -> None:
    record, start = started(bearing, 4)
    data = IdentificationData.from_record(record)
    weak = ControllerParameters(proportional_gain=4_000.0)  # below the 5000 A/m that balance the negative stiffness
    with pytest.raises(IdentificationError, match="start of order 4 is not stable"):
        focus_simulation(start, data, weak)
    with pytest.raises(IdentificationError, match=r"stable predictor; its spectral radius is 1\.0"):
        focus_simulation(bearing.model, data, PAPER)  # without Kalman gain
    with pytest.raises(IdentificationError, match="10 samples are too few for the 20 unknowns of order 4"):
        focus_simulation(start, data.window(0, 10), PAPER)
    without = replace(data.experiments[0], reference=None)
    with pytest.raises(IdentificationError, match="needs the reference, which these data lack"):
        focus_simulation(start, replace(data, experiments=(without,)), PAPER)
    broken = LoopRecord(0, record.sample_time, record.reference, record.position * np.nan, record.current)
    with pytest.raises(IdentificationError, match="needs finite data"):
        focus_simulation(start, IdentificationData.from_record(broken), PAPER)
    still = LoopRecord(0, record.sample_time, record.reference, record.position * [1.0, 0.0], record.current)
    with pytest.raises(IdentificationError, match="needs every position to move"):
        focus_simulation(start, IdentificationData.from_record(still), PAPER)
    with pytest.raises(IdentificationError, match="must have one sample time"):
        focus_simulation(start, data, ControllerParameters(sample_rate=20_000.0))


def _with_gain(model: StateSpaceModel) -> StateSpaceModel:
    """A bearing without Kalman gain with one that makes a stable predictor."""
    k = kalman_gain(model.a, model.c, model.b @ model.b.T, np.eye(2), np.zeros((model.order, 2)))
    return replace(model, k=k)


def _limited(model: StateSpaceModel, record: LoopRecord, controller: ControllerParameters) -> bool:
    """Whether the simulated loop meets the limit of its currents."""
    current = simulate_closed_loop(model, controller, record.reference).current
    return bool(np.any(np.abs(current) == controller.current_limit))
