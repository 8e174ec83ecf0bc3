"""Linear controllers: any discrete state-space law for all axes together, with current limits and anti-windup.

With the state x, the input u, the limited currents i and their values v before the limit,

    v[k] = C x[k] + D u[k],    i[k] = clip(v[k], -i_limit, i_limit),
    x[k+1] = A x[k] + B u[k] + K (i[k] - v[k]).

u is the position error r - y of each axis, or the reference r of each axis followed by the measured position y of
each. K acts only while a current is at its limit. Then the state follows the currents that flow instead of those it
asked for, with the dynamics A - K C: an observer of the controller's own state.

Source: K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., Prentice Hall, 1997, section 9.4.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import ParameterError
from amb_core.ground.given_values import require_kind
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.law import number_of_axes, set_samples
from amb_core.loop.linear_parameters import LinearControllerParameters, require_fit, state_at_rest, with_anti_windup
from amb_core.loop.pd_parameters import ControllerParameters, one_each, pack_gains

__all__ = [
    "LinearController",
    "LinearControllerParameters",
    "linear_law",
    "linear_start",
    "linear_update",
    "pd_as_linear",
    "require_fit",
    "state_at_rest",
    "with_anti_windup",
]


@numba.njit(cache=True)
def linear_update(
    state: NDArray[np.float64],
    after: NDArray[np.float64],
    matrices: tuple[
        NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]
    ],
    inputs: NDArray[np.float64],
    offset: NDArray[np.float64],
    limit: float,
    current: NDArray[np.float64],
) -> None:
    """Advance a linear controller by one sample.

    Parameters
    ----------
    state, after : ndarray, shape (n,)
        State (-), changed in place; the second is a place to work in.
    matrices : tuple of ndarray, shapes (n, n), (n, m), (axes, n), (axes, m), (n, axes)
        A, B, C, D and K, in the units of the signals.
    inputs : ndarray, shape (m,)
        u (m).
    offset : ndarray, shape (axes,)
        Added to v (A).
    limit : float
        Limit on the magnitude of the currents (A).
    current : ndarray, shape (axes,)
        Receives the limited currents (A).
    """
    a, b, c, d, k = matrices
    order, axes = len(state), len(current)
    for row in range(order):
        total = 0.0
        for column in range(order):
            total += a[row, column] * state[column]
        for column in range(len(inputs)):
            total += b[row, column] * inputs[column]
        after[row] = total
    for axis in range(axes):
        wanted = offset[axis]
        for column in range(order):
            wanted += c[axis, column] * state[column]
        for column in range(len(inputs)):
            wanted += d[axis, column] * inputs[column]
        current[axis] = min(max(wanted, -limit), limit)
        excess = current[axis] - wanted
        if excess != 0.0:
            for row in range(order):
                after[row] += k[row, axis] * excess
    state[:] = after


@numba.njit(cache=True)
def linear_start(state: NDArray[np.float64], at_rest: NDArray[np.float64], inputs: NDArray[np.float64]) -> None:
    """State before the first sample: that in which these inputs keep the controller at rest.

    A plain sum, since that of a library depends on the processor, and the real-time target must find the same bits.

    Parameters
    ----------
    state : ndarray, shape (n,)
        Receives the state (-).
    at_rest : ndarray, shape (n, m)
        From `state_at_rest` (1/m).
    inputs : ndarray, shape (m,)
        u (m).
    """
    for row in range(len(state)):
        total = 0.0
        for column in range(len(inputs)):
            total += at_rest[row, column] * inputs[column]
        state[row] = total


class LinearController:
    """A linear control law with its state.

    Its first sample finds it at rest: with the state that this sample would have brought about if it had lasted for
    ever, so that a rotor that starts elsewhere than at its reference causes no jump.

    Parameters
    ----------
    model : StateSpaceModel
        The law: inputs in m, outputs in A, one output per axis. Its K is the anti-windup gain, see `with_anti_windup`.
    parameters : LinearControllerParameters
        Limit and nominal reference.
    axes : int
        Number of axes of the machine.
    sample_rate : float
        That of the machine (Hz).

    Raises
    ------
    ParameterError
        If the model is for another number of axes, other signals or another sample rate.
    """

    def __init__(
        self, model: StateSpaceModel, parameters: LinearControllerParameters, axes: int, sample_rate: float
    ) -> None:
        require_kind("model", model, StateSpaceModel, "a StateSpaceModel, such as LinearControl.model", ParameterError)
        axes = number_of_axes(axes)
        require_fit(model, axes, sample_rate)
        self.model = model
        self._sample_rate = sample_rate
        self._with_errors = len(model.input_names) == axes
        self._matrices = (model.a, model.b, model.c, model.d, model.k)
        self._at_rest = state_at_rest(model)
        self._state, self._after = np.zeros((2, model.order))
        self._inputs, self._current = np.zeros(len(model.input_names)), np.zeros(axes)
        self._position, self._reference = np.zeros((2, axes))
        self._begun = False
        self.configure(parameters)

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self._current)

    @property
    def sample_rate(self) -> float:
        """Sample rate (Hz)."""
        return self._sample_rate

    def configure(self, parameters: LinearControllerParameters) -> None:
        """Use another limit and nominal reference from the next sample onwards; the state is kept.

        Parameters
        ----------
        parameters : LinearControllerParameters
            The new limit and nominal reference.

        Raises
        ------
        ParameterError
            If a nominal reference is given for another number of axes, or they are no LinearControllerParameters;
            nothing changes.
        """
        require_kind("parameters", parameters, LinearControllerParameters, "LinearControllerParameters", ParameterError)
        self.nominal_reference = one_each("nominal_reference", parameters.nominal_reference, 0.0, self.axes)
        self.parameters = parameters

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""
        self._begun = False

    def update(self, position: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Control current references (A), shape (axes,), for a measured and a reference position (m) of each axis.

        Parameters
        ----------
        position : array_like, shape (axes,)
            Measured position (m).
        reference : array_like, shape (axes,)
            Reference position (m).

        Returns
        -------
        ndarray, shape (axes,)
            Control current references (A), limited.

        Raises
        ------
        ParameterError
            If there is not one number for each axis.
        """
        set_samples(self._position, self._reference, position, reference)
        if self._with_errors:
            np.subtract(self._reference, self._position, out=self._inputs)
        else:
            self._inputs[: self.axes] = self._reference
            self._inputs[self.axes :] = self._position
        self._inputs -= self.model.input_offset
        if not self._begun:
            self._begun = True
            linear_start(self._state, self._at_rest, self._inputs)
        linear_update(
            self._state, self._after, self._matrices, self._inputs, self.model.output_offset,
            self.parameters.current_limit, self._current,
        )  # fmt: skip
        return self._current.copy()


def linear_law(controller: KnownController, axes: int) -> LinearSystem:
    """A controller without limits and offsets as a linear system, from references and positions (m) to currents (A).

    Parameters
    ----------
    controller : KnownController
        PD or linear controller.
    axes : int
        Number of axes.

    Returns
    -------
    LinearSystem
        The law, of 2 * axes inputs, or of `axes` inputs if it is one of errors.

    Raises
    ------
    ParameterError
        If it is made for another number of axes.
    """
    if isinstance(controller, LinearControl):
        controller.require_axes(axes)
    model = controller.model if isinstance(controller, LinearControl) else pd_as_linear(controller, axes)
    of_errors = model.inputs == axes
    b, d = (np.hstack([one, -one]) if of_errors else one for one in (model.b, model.d))
    return LinearSystem(model.a, b, model.c, d, 1.0 / controller.sample_rate)


def pd_as_linear(parameters: ControllerParameters, axes: int = 2) -> StateSpaceModel:
    """The decentralised PD controller (`PdController`, without its limit) as a linear one, two inputs an axis.

    With u = r - y, or u = -y for the derivative on measurement, filter pole a and weight w: s[k+1] = a s[k] + u[k],
    d[k] = w (a - 1) s[k] + w u[k], i = K_P (r - y) + K_D d.

    Parameters
    ----------
    parameters : ControllerParameters
        Gains and sample rate of the PD controller.
    axes : int, optional
        Number of axes.

    Returns
    -------
    StateSpaceModel
        The controller, with the references first among its inputs and the positions after them.
    """
    gains = pack_gains(parameters, axes)
    proportional, derivative, pole, weight, on_error = (np.diag(column) for column in gains[:, :5].T)
    one, none = np.eye(axes), np.zeros((axes, axes))
    return StateSpaceModel(
        a=pole,
        b=np.hstack([on_error, -one]),
        c=derivative @ weight @ (pole - one),
        d=np.hstack([proportional + derivative @ weight @ on_error, -proportional - derivative @ weight]),
        k=none,
        innovation_covariance=none,
        input_offset=np.zeros(2 * axes),
        output_offset=np.zeros(axes),
        initial_state=np.zeros(axes),
        sample_time=1.0 / parameters.sample_rate,
        input_names=tuple(f"r_{number}" for number in range(axes)) + tuple(f"y_{number}" for number in range(axes)),
        output_names=tuple(f"i_{number}" for number in range(axes)),
        input_units=("m",) * (2 * axes),
        output_units=("A",) * axes,
        method="pd",
    )
