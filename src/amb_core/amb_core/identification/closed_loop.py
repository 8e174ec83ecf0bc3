"""The identified model in closed loop with the known controller: simulation and poles.

An unstable plant cannot be validated by an open-loop simulation: any error grows without bound. In closed loop with the
controller of the experiment, the model must reproduce the response to the reference alone.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification.estimate.small_matrices import add_product, set_product
from amb_core.loop.control import STATE_SIZE, ControllerParameters, pack_gains, pd_update
from amb_core.loop.records import LoopRecord
from amb_core.model.state_space import StateSpaceModel

DIVERGED = 1e-2  # m, larger than the air gap of any bearing considered here


class DivergenceError(IdentificationError):
    """The simulated closed loop of model and controller diverges."""


def simulate_closed_loop(
    model: StateSpaceModel,
    controller: ControllerParameters,
    reference: NDArray[np.float64],
    first_step: int = 0,
    first_current: NDArray[np.float64] | None = None,
) -> LoopRecord:
    """Simulate the model under the control law of the experiment, current limit and offsets included.

    Parameters
    ----------
    model : StateSpaceModel
        Model without direct feedthrough; starts in its initial state.
    controller : ControllerParameters
        Parameters of the controller.
    reference : ndarray, shape (steps, 2)
        Reference position (m).
    first_step : int
        Controller step of the first sample.
    first_current : ndarray, shape (2,), optional
        Control current references at the first sample (A), for data that start within a run: they replace the
        controller's unknown past. By default the controller starts with the first sample.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together.
    DivergenceError
        If the position leaves the range of 10 mm; the message gives the step.
    """
    _check(model, controller)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    position, current = np.zeros_like(reference), np.zeros_like(reference)
    gains, state = pack_gains(controller), np.zeros(STATE_SIZE)
    if first_current is not None and len(reference):
        output = model.c @ model.initial_state + model.output_offset
        recall(state, gains, controller, output, reference[0], first_current)
    stopped = _simulate(
        model.a, model.b, model.c, model.input_offset, model.output_offset, model.initial_state.copy(),
        np.empty(model.order), gains, state, reference, position, current,
    )  # fmt: skip
    if stopped >= 0:
        raise DivergenceError(
            f"the closed loop of model and controller diverges: position beyond {DIVERGED * 1e3:g} mm "
            f"at step {first_step + stopped}"
        )
    return LoopRecord(first_step, model.sample_time, reference, position, current)


def closed_loop_poles(model: StateSpaceModel, controller: ControllerParameters) -> NDArray[np.complex128]:
    """Poles in the z plane of the model under the control law without its limit, shape (n + 4,), largest first.

    The states are those of the model and, per axis, the filtered derivative and the previous position of the
    backward difference.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together.
    """
    _check(model, controller)
    proportional, derivative, keep, weight, _, _ = pack_gains(controller)
    n = model.order
    # Controller: d+ = keep d + weight (h - y), h+ = y, u = -proportional y + derivative d+, with h the previous y.
    derived = np.hstack([-weight * model.c, keep * np.eye(2), weight * np.eye(2)])
    output = np.hstack([model.c, np.zeros((2, 4))])
    feedback = derivative * derived - proportional * output
    plant = np.hstack([model.a, np.zeros((n, 4))]) + model.b @ feedback
    poles = np.linalg.eigvals(np.vstack([plant, derived, output])).astype(np.complex128)
    return poles[np.argsort(-np.abs(poles), kind="stable")]


def _check(model: StateSpaceModel, controller: ControllerParameters) -> None:
    if model.b.shape[1] != 2 or model.c.shape[0] != 2:
        raise IdentificationError("the model must have two inputs and two outputs, as the controller has")
    if np.any(model.d):
        raise IdentificationError("the model must have no direct feedthrough (D = 0) to be put in closed loop")
    if abs(model.sample_time * controller.sample_rate - 1.0) > 1e-9:
        raise IdentificationError(
            f"model and controller must have one sample time: {model.sample_time:g} s "
            f"and {1.0 / controller.sample_rate:g} s"
        )


def recall(
    state: NDArray[np.float64],
    gains: NDArray[np.float64],
    controller: ControllerParameters,
    output: NDArray[np.float64],
    reference: NDArray[np.float64],
    current: NDArray[np.float64],
) -> None:
    """Set the state that the controller had before a sample, from the currents with which it responded to that sample.

    At the current limit the derivative is only known to be large, but then it has hardly any influence on the following
    samples: without a filter it is lost after one sample.
    """
    proportional, derivative, keep, weight, on_error, _ = gains
    if derivative == 0.0:
        return
    derived = (current - proportional * (reference - output)) / derivative
    # Of the two states that lead to `derived`, the filtered derivative is taken to be stationary.
    state[0:2] = derived
    state[2:4] = on_error * reference - output - (1.0 - keep) * derived / weight
    state[4] = 1.0


@numba.njit(cache=True)
def _simulate(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    input_offset: NDArray[np.float64],
    output_offset: NDArray[np.float64],
    state: NDArray[np.float64],
    advanced: NDArray[np.float64],
    gains: NDArray[np.float64],
    controller_state: NDArray[np.float64],
    reference: NDArray[np.float64],
    position: NDArray[np.float64],
    current: NDArray[np.float64],
) -> int:
    """Fill in `position` and `current` from the state at the first step; returns the step of divergence, or -1.

    `advanced` is work space of the shape of `state`.
    """
    deviation = np.empty(2)
    for step in range(len(reference)):
        set_product(c, state, position[step])
        x = position[step, 0] = position[step, 0] + output_offset[0]
        y = position[step, 1] = position[step, 1] + output_offset[1]
        if not (abs(x) < DIVERGED and abs(y) < DIVERGED):  # catches NaN too
            return step
        pd_update(controller_state, gains, x, y, reference[step, 0], reference[step, 1], current[step])
        for axis in range(2):
            deviation[axis] = current[step, axis] - input_offset[axis]
        set_product(a, state, advanced)
        add_product(b, deviation, advanced)
        state, advanced = advanced, state
    return -1
