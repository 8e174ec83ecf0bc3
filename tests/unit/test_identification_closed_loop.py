"""The model in closed loop with the known controller: same samples as the loop itself, poles, divergence, fit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.linalg import block_diag

from amb_core.ground.errors import IdentificationError
from amb_core.identification import closed_loop_poles, nrmse_fit, simulate_closed_loop
from amb_core.identification.closed_loop import DivergenceError
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord

if TYPE_CHECKING:
    from conftest import LinearBearing

CONTROLLERS = [
    ControllerParameters(),
    ControllerParameters(derivative_filter=3e-4),
    ControllerParameters(derivative_on="measurement"),
    ControllerParameters(derivative_filter=3e-4, derivative_on="measurement", current_limit=2.5),
]


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_the_true_model_gives_the_samples_of_the_loop(bearing: LinearBearing, controller: ControllerParameters) -> None:
    record = bearing.experiment(noise=0.0, duration=0.4, controller=controller)
    simulation = simulate_closed_loop(bearing.model, controller, record.reference)
    # Rounding only, amplified by the unstable plant inside a stable loop.
    assert np.max(np.abs(simulation.position - record.position)) < 1e-14
    assert np.max(np.abs(simulation.current - record.current)) < 1e-8
    assert simulation.first_step == 0


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_record_from_amid_a_run_is_continued_from_its_first_current(
    bearing: LinearBearing, controller: ControllerParameters
) -> None:
    record = bearing.experiment(noise=0.0, duration=0.4, lead=300, controller=controller)
    start = 50  # amid the fall to the sag, where the derivative is not zero
    window = record.window(start, record.steps - start)
    model = replace(bearing.model, initial_state=_state_after(bearing, start, record))
    simulation = simulate_closed_loop(model, controller, window.reference, start, window.current[0])
    assert simulation.first_step == start
    assert np.max(np.abs(simulation.position - window.position)) < 1e-14


@pytest.mark.parametrize("controller", CONTROLLERS[:3])
def test_closed_loop_poles_are_the_modes_of_the_loop(bearing: LinearBearing, controller: ControllerParameters) -> None:
    # Free motion about the operating point, unlimited: its samples obey the characteristic polynomial of the poles.
    unlimited = controller.model_copy(update={"current_limit": 100.0})
    model = replace(bearing.model, input_offset=np.zeros(2), initial_state=np.array([1e-6, 0.0, -2e-6, 1e-4, 0.0, 0.1]))
    poles = closed_loop_poles(model, unlimited)
    assert len(poles) == model.order + 2  # of the controller: one state per axis
    free = simulate_closed_loop(model, unlimited, np.zeros((200, 2))).position
    characteristic = np.poly(poles).real
    for axis in range(2):
        residual = np.convolve(free[:, axis], characteristic, mode="valid")
        # The first sample has no backward difference, so the recursion holds from the second sample on.
        assert np.max(np.abs(residual[1:])) < 1e-9 * np.max(np.abs(free[:, axis]))


def test_two_bearings_side_by_side_are_one_loop_of_four_axes(bearing: LinearBearing) -> None:
    record = bearing.experiment(noise=0.0, duration=0.1, controller=CONTROLLERS[1])
    one = bearing.model
    both = replace(
        one,
        **{name: block_diag(getattr(one, name), getattr(one, name)) for name in ("a", "b", "c", "d", "k")},
        **{name: np.tile(getattr(one, name), 2) for name in ("input_offset", "output_offset", "initial_state")},
        innovation_covariance=block_diag(one.innovation_covariance, one.innovation_covariance),
        input_names=("i_x_a", "i_y_a", "i_x_b", "i_y_b"),
        output_names=("x_a", "y_a", "x_b", "y_b"),
        input_units=("A",) * 4,
        output_units=("m",) * 4,
    )
    per_axis = CONTROLLERS[1].model_copy(
        update={"proportional_gains": (20_000.0,) * 4, "derivative_gains": (38.0,) * 4}
    )
    simulated = simulate_closed_loop(both, per_axis, np.hstack([record.reference, record.reference]))
    for part in (slice(0, 2), slice(2, 4)):
        assert np.max(np.abs(simulated.position[:, part] - record.position)) < 1e-14
        assert np.max(np.abs(simulated.current[:, part] - record.current)) < 1e-8
    poles = closed_loop_poles(both, per_axis)
    np.testing.assert_allclose(np.abs(poles), np.repeat(np.abs(closed_loop_poles(one, CONTROLLERS[1])), 2), atol=1e-9)


def test_the_dominant_closed_loop_poles_are_those_of_the_paper(bearing: LinearBearing) -> None:
    poles = closed_loop_poles(bearing.model, ControllerParameters())
    dominant = np.log(poles[poles != 0.0]) / bearing.sample_time
    oscillating = dominant[np.abs(dominant.imag) > 1.0]
    slowest = oscillating[np.argsort(-oscillating.real)][:4]
    frequency = np.abs(slowest) / (2.0 * np.pi)
    ideal = np.sqrt((bearing.current_gain * 20_000.0 - bearing.stiffness_x) / bearing.mass) / (2.0 * np.pi)
    assert ideal == pytest.approx(63.4, abs=0.1)
    # The actuators' lag makes the loop a little stiffer than the ideal one.
    assert frequency == pytest.approx(np.full(4, ideal), rel=0.06)


def test_a_diverging_loop_stops_with_its_step(bearing: LinearBearing) -> None:
    weak = ControllerParameters(proportional_gain=4_000.0)  # below the 5000 A/m that balance the negative stiffness
    with pytest.raises(DivergenceError, match=r"diverges: position beyond 10 mm at step 1\d\d\d"):
        simulate_closed_loop(bearing.model, weak, np.zeros((5_000, 2)), first_step=1_000)


def test_a_model_with_feedthrough_or_another_sample_time_is_refused(bearing: LinearBearing) -> None:
    reference = np.zeros((10, 2))
    with pytest.raises(IdentificationError, match="no direct feedthrough"):
        simulate_closed_loop(replace(bearing.model, d=np.eye(2)), ControllerParameters(), reference)
    with pytest.raises(IdentificationError, match=r"one sample time: 0\.0001 s and 5e-05 s"):
        closed_loop_poles(bearing.model, ControllerParameters(sample_rate=20_000.0))


def test_fit_is_100_for_the_signal_itself_and_0_for_its_mean() -> None:
    signal = np.column_stack([np.sin(np.arange(100.0)), np.arange(100.0)])
    assert nrmse_fit(signal, signal) == pytest.approx([100.0, 100.0])
    assert nrmse_fit(signal, np.tile(signal.mean(axis=0), (100, 1))) == pytest.approx([0.0, 0.0])
    spread = np.linalg.norm(signal - signal.mean(axis=0), axis=0)
    assert nrmse_fit(signal, signal + 0.1) == pytest.approx(100.0 * (1.0 - 1.0 / spread))


@pytest.mark.parametrize(
    ("measured", "modelled", "message"),
    [
        (np.ones((5, 2)), np.zeros((5, 2)), "output 1 is constant"),
        (np.zeros((5, 2)), np.zeros((4, 2)), "alike"),
        (np.full((5, 2), np.nan), np.zeros((5, 2)), "finite"),
    ],
)
def test_a_fit_that_is_not_defined_is_refused(measured: np.ndarray, modelled: np.ndarray, message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        nrmse_fit(measured, modelled)


def _state_after(bearing: LinearBearing, steps: int, record: LoopRecord) -> np.ndarray:
    model = bearing.model
    state = model.initial_state
    for current in record.current[:steps]:
        state = model.a @ state + model.b @ (current - model.input_offset)
    return state
