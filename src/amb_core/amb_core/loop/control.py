"""The decoupled PD position controller: one control law for the node, the ROS-free loop and model validation.

It acts on each axis by itself. Per axis, with position error e = r - y, sample time T and derivative filter time
constant tau_f,

    d[k] = (tau_f d[k-1] + e[k] - e[k-1]) / (tau_f + T)      (filtered backward difference)
    i[k] = clip(K_P e[k] + K_D d[k], -i_limit, i_limit)

which is the paper's Fig. 10 (derivative on error). With the derivative on measurement, e is replaced by -y in d.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.errors import ParameterError
from amb_core.parameters import (
    Parameters,
    choice,
    flatten,
    of_machine,
    quantities,
    quantity,
    validate,
)


def current_limit() -> Any:
    """Declaration of the limit that every controller has."""
    return quantity(3.0, "A", "limit on the magnitude of the control current references", 0.0, 100.0, runtime=True)


def nominal_reference() -> Any:
    """Declaration of the nominal reference that every controller has."""
    return quantities(
        "m", "nominal reference position of each axis, in their order; empty: 0 on all", -1e-3, 1e-3, runtime=True
    )


class ControllerParameters(Parameters):
    """Parameters of the PD controller: the same gains on all axes (paper, table 1), or others on each."""

    sample_rate: float = of_machine(
        10_000.0, "Hz", "controller sample rate f_s", 1_000.0, 100_000.0, simulator_parameter="integration.sample_rate"
    )
    proportional_gain: float = quantity(20_000.0, "A/m", "proportional gain K_P", 0.0, 1e6, runtime=True)
    derivative_gain: float = quantity(38.0, "A s/m", "derivative gain K_D", 0.0, 1e4, runtime=True)
    derivative_filter: float = quantity(
        0.0, "s", "time constant of the first-order filter on the derivative; 0 for none", 0.0, 0.1, runtime=True
    )
    derivative_on: Literal["error", "measurement"] = choice(
        "error", "signal that is differentiated: the position error (paper, Fig. 10) or the measured position"
    )
    current_limit: float = current_limit()
    proportional_gains: tuple[float, ...] = quantities(
        "A/m", "K_P of each axis, in the order of the axes; empty: proportional_gain on all", 0.0, 1e6, runtime=True
    )
    derivative_gains: tuple[float, ...] = quantities(
        "A s/m", "K_D of each axis, in the order of the axes; empty: derivative_gain on all", 0.0, 1e4, runtime=True
    )
    nominal_reference: tuple[float, ...] = nominal_reference()

    def at_rate(self, sample_rate: float) -> Self:
        """The same controller at the sample rate of a machine (Hz).

        Raises
        ------
        ParameterError
            If the rate is out of its range.
        """
        if sample_rate == self.sample_rate:
            return self
        return validate(type(self), {**flatten(self.model_dump()), "sample_rate": sample_rate})

    def references(self, axes: int) -> NDArray[np.float64]:
        """Nominal reference position of each axis (m), shape (axes,).

        Raises
        ------
        ParameterError
            If `nominal_reference` is given for another number of axes.
        """
        return one_each("nominal_reference", self.nominal_reference, 0.0, axes)

    def require_axes(self, axes: int) -> None:
        """Raise ParameterError if a list is given for another number of axes."""
        pack_gains(self, axes)
        self.references(axes)


def with_present_names(values: Mapping[str, object]) -> dict[str, object]:
    """Parameters as version 0.1 recorded them, where the nominal reference of x and y had a name each."""
    found = dict(values)
    former = [found.pop(f"nominal_reference_{axis}", None) for axis in "xy"]
    if any(former):
        found["nominal_reference"] = [value or 0.0 for value in former]
    return found


@numba.njit(cache=True)
def pd_update(
    state: NDArray[np.float64],
    gains: NDArray[np.float64],
    position: NDArray[np.float64],
    reference: NDArray[np.float64],
    current: NDArray[np.float64],
) -> None:
    """Advance the control law by one sample.

    Parameters
    ----------
    state : ndarray, shape (2 * axes + 1,)
        State of the law, changed in place, see `initial_state`.
    gains : ndarray, shape (axes, 6)
        From `pack_gains`.
    position, reference : ndarray, shape (axes,)
        Measured position and reference position (m).
    current : ndarray, shape (axes,)
        Receives the control current references (A).
    """
    axes = len(position)
    for axis in range(axes):
        proportional, derivative, keep = gains[axis, 0], gains[axis, 1], gains[axis, 2]
        weight, on_error, limit = gains[axis, 3], gains[axis, 4], gains[axis, 5]
        differentiated = on_error * reference[axis] - position[axis]
        if state[2 * axes] == 0.0:
            state[axes + axis] = differentiated
        state[axis] = keep * state[axis] + weight * (differentiated - state[axes + axis])
        state[axes + axis] = differentiated
        error = reference[axis] - position[axis]
        current[axis] = min(max(proportional * error + derivative * state[axis], -limit), limit)
    state[2 * axes] = 1.0


def initial_state(axes: int) -> NDArray[np.float64]:
    """State of `pd_update` before the first sample, shape (2 * axes + 1,).

    It holds the filtered derivative of each axis, the previous differentiated signal of each, and 1 once there is one.
    """
    return np.zeros(2 * axes + 1)


def require_one_rate(controller_rate: float, sample_rate: float) -> None:
    """Raise ParameterError unless the controller runs at the sample rate of the plant (both Hz)."""
    if abs(controller_rate - sample_rate) > 1e-9 * sample_rate:
        raise ParameterError(
            f"the controller runs at {controller_rate:g} Hz, the plant is sampled at {sample_rate:g} Hz; "
            "the two rates must be equal"
        )


def pack_gains(parameters: ControllerParameters, axes: int) -> NDArray[np.float64]:
    """Coefficients of `pd_update`, shape (axes, 6).

    They are K_P, K_D, filter pole, difference weight, 1 for derivative on error, limit.

    Raises
    ------
    ParameterError
        If gains are given for another number of axes.
    """
    sample_time = 1.0 / parameters.sample_rate
    span = parameters.derivative_filter + sample_time
    gains = np.empty((axes, 6))
    gains[:, 0] = one_each("proportional_gains", parameters.proportional_gains, parameters.proportional_gain, axes)
    gains[:, 1] = one_each("derivative_gains", parameters.derivative_gains, parameters.derivative_gain, axes)
    gains[:, 2] = parameters.derivative_filter / span
    gains[:, 3] = 1.0 / span
    gains[:, 4] = 1.0 if parameters.derivative_on == "error" else 0.0
    gains[:, 5] = parameters.current_limit
    return gains


def one_each(name: str, values: tuple[float, ...], default: float, axes: int) -> NDArray[np.float64]:
    """One value per axis, shape (axes,); the default on all where no values are given.

    Raises
    ------
    ParameterError
        If they are given for another number of axes.
    """
    if values and len(values) != axes:
        raise ParameterError(f"{name} has {len(values)} values; the machine has {axes} axes; allowed: {axes}, or none")
    return np.array(values) if values else np.full(axes, default)


class PdController:
    """The control law of a number of axes with its state: one call of `update` per controller sample.

    Raises
    ------
    ParameterError
        If parameters are given for another number of axes.
    """

    def __init__(self, parameters: ControllerParameters, axes: int = 2) -> None:
        self._state = initial_state(axes)
        self._position, self._reference, self._current = np.zeros((3, axes))
        self.configure(parameters)

    @property
    def axes(self) -> int:
        """Number of axes."""
        return len(self._current)

    @property
    def sample_rate(self) -> float:
        """Sample rate (Hz)."""
        return self.parameters.sample_rate

    def configure(self, parameters: ControllerParameters) -> None:
        """Use new parameters from the next sample onwards; the state is kept.

        Raises
        ------
        ParameterError
            If parameters are given for another number of axes; nothing changes.
        """
        gains, nominal = pack_gains(parameters, self.axes), parameters.references(self.axes)
        self.parameters, self._gains, self.nominal_reference = parameters, gains, nominal

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""
        self._state[:] = 0.0

    def update(self, position: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Control current references (A), shape (axes,), for a measured and a reference position (m) of each axis."""
        self._position[:] = position
        self._reference[:] = reference
        pd_update(self._state, self._gains, self._position, self._reference, self._current)
        return self._current.copy()
