"""Parameters of a linear law (`linear_control`) and what its matrices must be: apart from it, without a compiler."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Parameters
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.pd_parameters import current_limit, nominal_reference, one_each

ON_THE_CIRCLE = 1e-6  # a pole of magnitude 1 - this or more does not forget what happened at the limit


class LinearControllerParameters(Parameters):
    """Parameters of a linear controller, besides its matrices."""

    current_limit: float = current_limit()
    nominal_reference: tuple[float, ...] = nominal_reference()

    def require_axes(self, axes: int) -> None:
        """Check that no list is given for another number of axes.

        Parameters
        ----------
        axes : int
            Number of axes of the machine.

        Raises
        ------
        ParameterError
            If one is.
        """
        one_each("nominal_reference", self.nominal_reference, 0.0, axes)


def state_at_rest(model: StateSpaceModel) -> NDArray[np.float64]:
    """State of a controller at rest per unit of each constant input, shape (n, m).

    A law whose inputs do not reach its state, such as a generator of tones, begins with the initial state of its model
    for each metre of its first input, which an input offset of -1 m makes one.

    Parameters
    ----------
    model : StateSpaceModel
        The controller.

    Returns
    -------
    ndarray, shape (n, m)
        State for an input of 1 m (1/m).
    """
    if model.order and not model.b.any():
        return np.outer(model.initial_state, np.eye(1, model.inputs)[0])
    return np.linalg.pinv(np.eye(model.order) - model.a) @ model.b


def with_anti_windup(model: StateSpaceModel) -> StateSpaceModel:
    """A controller with an anti-windup gain, unless it has one (K) or forgets by itself what happened at the limit.

    A controller whose poles all lie well inside the unit circle keeps K = 0. For an integrating or unstable one K is
    the stationary Kalman gain for white noise of equal variance on its inputs and outputs: A - K C is stable.

    Parameters
    ----------
    model : StateSpaceModel
        The controller.

    Returns
    -------
    StateSpaceModel
        The controller with K; the same if it needs none.

    Raises
    ------
    ParameterError
        If no gain makes it stable: a pole on or outside the unit circle that its outputs do not show.
    """
    if model.k.any() or not len(model.a) or np.abs(model.poles()).max() < 1.0 - ON_THE_CIRCLE:
        return model
    from scipy.linalg import solve_discrete_are

    outputs = len(model.c)
    try:
        covariance = solve_discrete_are(model.a.T, model.c.T, model.b @ model.b.T, np.eye(outputs))
    except (ValueError, np.linalg.LinAlgError) as problem:
        raise ParameterError(f"no anti-windup gain is found for the controller: {problem}; give it as K") from None
    k = model.a @ covariance @ model.c.T @ np.linalg.inv(model.c @ covariance @ model.c.T + np.eye(outputs))
    return replace(model, k=k)


def require_fit(model: StateSpaceModel, axes: int, sample_rate: float) -> None:
    """Check that a controller is for a number of axes, their signals and a sample rate.

    Parameters
    ----------
    model : StateSpaceModel
        The controller.
    axes : int
        Number of axes of the machine.
    sample_rate : float
        Sample rate of the machine (Hz).

    Raises
    ------
    ParameterError
        If it is for others.
    """
    inputs, outputs = len(model.input_names), len(model.output_names)
    if outputs != axes or inputs not in (axes, 2 * axes):
        raise ParameterError(
            f"the controller has {inputs} inputs and {outputs} outputs, the machine {axes} axes; allowed: {axes} "
            f"outputs, and {axes} inputs (errors) or {2 * axes} (references, then positions)"
        )
    if abs(model.sample_time * sample_rate - 1.0) > 1e-6:
        raise ParameterError(
            f"the controller is made for a sample time of {model.sample_time:g} s; that of the machine is "
            f"{1.0 / sample_rate:g} s"
        )
    units = {*model.input_units, "/", *model.output_units}
    if units - {"/", "m", "A", ""} or "A" in model.input_units or "m" in model.output_units:
        raise ParameterError(
            f"the controller takes {', '.join(model.input_units)} and gives {', '.join(model.output_units)}; allowed: "
            "m and A"
        )


def require_order(model: StateSpaceModel, axes: Sequence[str]) -> None:
    """Raise ParameterError if a controller names the axes of a machine in another order than the machine has them.

    A name such as `i_x`, `r_x` or `x` is that of the axis x; other names have no order.
    """
    count = len(axes)
    for what, names in (("inputs", model.input_names), ("outputs", model.output_names)):
        places = [_axis_of(name, axes) for name in names]
        if any(place is not None and place != number % count for number, place in enumerate(places)):
            raise ParameterError(
                f"the controller has the {what} {', '.join(names)}; the axes of the machine are {', '.join(axes)}: its "
                "channels must be in this order"
            )


def _axis_of(name: str, axes: Sequence[str]) -> int | None:
    """The axis that a signal names, whole or behind a prefix; None for another name."""
    for text in (name, name.partition("_")[2]):
        if text in axes:
            return list(axes).index(text)
    return None
