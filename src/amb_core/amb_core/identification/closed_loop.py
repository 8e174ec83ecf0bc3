"""The identified model in closed loop with the known controller: simulation and poles.

An unstable plant cannot be validated by an open-loop simulation: any error grows without bound. In closed loop with the
controller of the experiment, the model must reproduce the response to the reference alone.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import numbers, require_kind, whole_number
from amb_core.ground.sample_times import difference, same_sample_time
from amb_core.identification.control_law import Law, Start, advance_law, law_of, recall, state_of
from amb_core.linear import LinearSystem
from amb_core.linear.connections import feedback
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.small_matrices import add_product, set_product
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import linear_law
from amb_core.loop.linear_parameters import require_order
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.records import LoopRecord

DIVERGED = 1e-2  # m, larger than the air gap of any bearing considered here


class DivergenceError(IdentificationError):
    """The simulated closed loop of model and controller diverges."""


def simulate_closed_loop(
    model: StateSpaceModel,
    controller: KnownController,
    reference: NDArray[np.float64],
    first_step: int = 0,
    start: Start | NDArray[np.float64] | None = None,
) -> LoopRecord:
    """Simulate the model under the control law of the experiment, current limit and offsets included.

    Parameters
    ----------
    model : StateSpaceModel
        Model without direct feedthrough; starts in its initial state.
    controller : KnownController
        The PD controller or a linear one.
    reference : ndarray, shape (steps, axes)
        Reference position (m).
    first_step : int, optional
        Controller step of the first sample.
    start : Start or ndarray, shape (axes,), optional
        The controller's past, for data that start within a run (see `start_of`), or no more of it than its control
        current references at the first sample (A). By default the controller starts with the first sample.

    Returns
    -------
    LoopRecord
        References (m), simulated positions (m) and currents (A) of every step.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    DivergenceError
        If the position leaves the range of 10 mm; the message gives the step.
    """
    axes = loop_axes(model, controller)
    first_step = whole_number("first_step", first_step, IdentificationError)
    reference = np.ascontiguousarray(numbers("reference", reference, IdentificationError))
    if reference.shape[1:] != (axes,):
        raise IdentificationError(f"reference of shape {reference.shape} is not allowed; allowed: (steps, {axes})")
    position, current = np.zeros_like(reference), np.zeros_like(reference)
    law = law_of(controller, axes)
    state = state_of(law)
    if start is not None and len(reference):
        output = model.c @ model.initial_state + model.output_offset
        recall(law, state, output, reference[0], start if isinstance(start, Start) else Start(start))
    stopped = _simulate(
        model.a, model.b, model.c, model.input_offset, model.output_offset, model.initial_state.copy(),
        np.empty(model.order), law, state, reference, position, current,
    )  # fmt: skip
    if stopped >= 0:
        raise DivergenceError(
            f"the closed loop of model and controller diverges: position beyond {DIVERGED * 1e3:g} mm "
            f"at step {first_step + stopped}"
        )
    return LoopRecord(first_step, model.sample_time, reference, position, current)


def closed_loop_poles(model: StateSpaceModel, controller: KnownController) -> NDArray[np.complex128]:
    """Poles in the z plane of the model under the control law without its limit, largest first.

    Parameters
    ----------
    model : StateSpaceModel
        Model without direct feedthrough.
    controller : KnownController
        The PD law, which has one state per axis, or a linear one.

    Returns
    -------
    ndarray of complex, shape (n + c,)
        Poles (-): the states are those of the model and of the controller.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    """
    return loop_of(model, controller).poles()


def loop_of(model: StateSpaceModel, controller: KnownController) -> LinearSystem:
    """The model in the loop of the control law without its limit: from (r, w_u, w_y) to (u, y), see `feedback`.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    """
    axes = loop_axes(model, controller)
    controller.require_axes(axes)
    return feedback(model, linear_law(controller, axes), references=axes)


def complementary_sensitivity(
    model: StateSpaceModel, controller: KnownController, frequency: float
) -> NDArray[np.complex128]:
    """T = I - S of the loop, its limit aside, at a frequency (Hz); shape (axes, axes)."""
    sensitivity = loop_of(model, controller).part(*_of_positions(model))
    return np.asarray(np.eye(model.outputs) - sensitivity.response([frequency])[0])


def _of_positions(model: StateSpaceModel) -> tuple[slice, slice]:
    """Which outputs and inputs of `loop_of` are the positions and what disturbs their measurement."""
    return slice(model.inputs, None), slice(2 * model.inputs, None)


def loop_axes(model: StateSpaceModel, controller: KnownController) -> int:
    """Number of axes of the loop."""
    require_kind("model", model, StateSpaceModel, "a StateSpaceModel", IdentificationError)
    allowed = "ControllerParameters or LinearControl, as named_controller makes them"
    require_kind("controller", controller, (ControllerParameters, LinearControl), allowed, IdentificationError)
    inputs, outputs = model.b.shape[1], model.c.shape[0]
    if inputs != outputs:
        raise IdentificationError(
            f"the model has {inputs} inputs and {outputs} outputs; a controller of axes needs as many of both"
        )
    if np.any(model.d):
        raise IdentificationError("the model must have no direct feedthrough (D = 0) to be put in closed loop")
    if not same_sample_time(1.0 / controller.sample_rate, model.sample_time):
        raise IdentificationError(
            f"model and controller must have one sample time: {model.sample_time:g} s "
            f"and {1.0 / controller.sample_rate:g} s; {difference(1.0 / controller.sample_rate, model.sample_time)}"
        )
    if isinstance(controller, LinearControl):
        require_order(controller.model, model.output_names)
    return inputs


@numba.njit(cache=True)
def _simulate(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    c: NDArray[np.float64],
    input_offset: NDArray[np.float64],
    output_offset: NDArray[np.float64],
    state: NDArray[np.float64],
    advanced: NDArray[np.float64],
    law: Law,
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
        advance_law(law, controller_state, position[step], reference[step], current[step])
        for axis in range(axes):
            deviation[axis] = current[step, axis] - input_offset[axis]
        set_product(a, state, advanced)
        add_product(b, deviation, advanced)
        state, advanced = advanced, state
    return -1
