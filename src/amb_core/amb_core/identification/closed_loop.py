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
from amb_core.loop.control import ControllerParameters, initial_state, pack_gains, pd_update
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
    reference : ndarray, shape (steps, axes)
        Reference position (m).
    first_step : int
        Controller step of the first sample.
    first_current : ndarray, shape (axes,), optional
        Control current references at the first sample (A), for data that start within a run: they replace the
        controller's unknown past. By default the controller starts with the first sample.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together.
    DivergenceError
        If the position leaves the range of 10 mm; the message gives the step.
    """
    axes = loop_axes(model, controller)
    reference = np.ascontiguousarray(reference, dtype=np.float64)
    position, current = np.zeros_like(reference), np.zeros_like(reference)
    gains, state = pack_gains(controller, axes), initial_state(axes)
    if first_current is not None and len(reference):
        output = model.c @ model.initial_state + model.output_offset
        recall(state, gains, output, reference[0], first_current)
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
    """Poles in the z plane of the model under the control law without its limit, shape (n + 2 axes,), largest first.

    The states are those of the model and, per axis, the filtered derivative and the previous position of the
    backward difference.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together.
    """
    axes = loop_axes(model, controller)
    proportional, derivative, keep, weight = (np.diag(gain) for gain in pack_gains(controller, axes)[:, :4].T)
    n = model.order
    # Controller: d+ = keep d + weight (h - y), h+ = y, u = -proportional y + derivative d+, with h the previous y.
    derived = np.hstack([-weight @ model.c, keep, weight])
    output = np.hstack([model.c, np.zeros((axes, 2 * axes))])
    feedback = derivative @ derived - proportional @ output
    plant = np.hstack([model.a, np.zeros((n, 2 * axes))]) + model.b @ feedback
    poles = np.linalg.eigvals(np.vstack([plant, derived, output])).astype(np.complex128)
    return poles[np.argsort(-np.abs(poles), kind="stable")]


def loop_axes(model: StateSpaceModel, controller: ControllerParameters) -> int:
    """Number of axes of the loop."""
    inputs, outputs = model.b.shape[1], model.c.shape[0]
    if inputs != outputs:
        raise IdentificationError(
            f"the model has {inputs} inputs and {outputs} outputs; a controller of axes needs as many of both"
        )
    if np.any(model.d):
        raise IdentificationError("the model must have no direct feedthrough (D = 0) to be put in closed loop")
    if abs(model.sample_time * controller.sample_rate - 1.0) > 1e-9:
        raise IdentificationError(
            f"model and controller must have one sample time: {model.sample_time:g} s "
            f"and {1.0 / controller.sample_rate:g} s"
        )
    return inputs


def recall(
    state: NDArray[np.float64],
    gains: NDArray[np.float64],
    output: NDArray[np.float64],
    reference: NDArray[np.float64],
    current: NDArray[np.float64],
) -> None:
    """Set the state that the controller had before a sample, from the currents with which it responded to that sample.

    At the current limit the derivative is only known to be large, but then it has hardly any influence on the following
    samples: without a filter it is lost after one sample.
    """
    proportional, derivative, keep, weight, on_error, _ = gains.T
    if not derivative.any():
        return
    axes = len(gains)
    # On an axis without derivative the state has no effect.
    derived = (current - proportional * (reference - output)) / np.where(derivative == 0.0, 1.0, derivative)
    # Of the two states that lead to `derived`, the filtered derivative is taken to be stationary.
    state[:axes] = derived
    state[axes : 2 * axes] = on_error * reference - output - (1.0 - keep) * derived / weight
    state[2 * axes] = 1.0


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
    axes = len(output_offset)
    deviation = np.empty(axes)
    for step in range(len(reference)):
        set_product(c, state, position[step])
        for axis in range(axes):
            position[step, axis] += output_offset[axis]
            if not abs(position[step, axis]) < DIVERGED:  # catches NaN too
                return step
        pd_update(controller_state, gains, position[step], reference[step], current[step])
        for axis in range(axes):
            deviation[axis] = current[step, axis] - input_offset[axis]
        set_product(a, state, advanced)
        add_product(b, deviation, advanced)
        state, advanced = advanced, state
    return -1
