"""The decoupled PD position controller: one control law for the node, the ROS-free loop and model validation.

It acts on each axis by itself. Per axis, with position error e = r - y, sample time T and derivative filter time
constant tau_f,

    d[k] = (tau_f d[k-1] + e[k] - e[k-1]) / (tau_f + T)      (filtered backward difference)
    i[k] = clip(K_P e[k] + K_D d[k], -i_limit, i_limit)

which is the paper's Fig. 10 (derivative on error). With the derivative on measurement, e is replaced by -y in d.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import ParameterError
from amb_core.ground.given_values import require_kind
from amb_core.loop.law import number_of_axes, set_samples
from amb_core.loop.pd_parameters import (
    ControllerParameters,
    current_limit,
    nominal_reference,
    one_each,
    pack_gains,
    require_one_rate,
    with_present_names,
)

__all__ = [
    "ControllerParameters",
    "PdController",
    "current_limit",
    "initial_state",
    "nominal_reference",
    "one_each",
    "pack_gains",
    "pd_update",
    "require_one_rate",
    "with_present_names",
]


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
        State of the law (m, apart from its last entry), changed in place, see `initial_state`.
    gains : ndarray, shape (axes, 6)
        From `pack_gains`, in the units of their parameters.
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

    Parameters
    ----------
    axes : int
        Number of axes.

    Returns
    -------
    ndarray, shape (2 * axes + 1,)
        Zeros.
    """
    return np.zeros(2 * axes + 1)


class PdController:
    """The control law of a number of axes with its state: one call of `update` per controller sample.

    Parameters
    ----------
    parameters : ControllerParameters
        Gains, limit, sample rate and nominal reference.
    axes : int, optional
        Number of axes.

    Raises
    ------
    ParameterError
        If parameters are given for another number of axes.
    """

    def __init__(self, parameters: ControllerParameters, axes: int = 2) -> None:
        axes = number_of_axes(axes)
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

        Parameters
        ----------
        parameters : ControllerParameters
            The new parameters.

        Raises
        ------
        ParameterError
            If parameters are given for another number of axes, or are no ControllerParameters; nothing changes.
        """
        require_kind("parameters", parameters, ControllerParameters, "ControllerParameters", ParameterError)
        gains, nominal = pack_gains(parameters, self.axes), parameters.references(self.axes)
        self.parameters, self._gains, self.nominal_reference = parameters, gains, nominal

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""
        self._state[:] = 0.0

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
        pd_update(self._state, self._gains, self._position, self._reference, self._current)
        return self._current.copy()
