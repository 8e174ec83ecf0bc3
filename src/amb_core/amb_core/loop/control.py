"""The decoupled PD position controller: one control law for the node, the ROS-free loop and model validation.

Per axis, with position error e = r - y, sample time T and derivative filter time constant tau_f,

    d[k] = (tau_f d[k-1] + e[k] - e[k-1]) / (tau_f + T)      (filtered backward difference)
    i[k] = clip(K_P e[k] + K_D d[k], -i_limit, i_limit)

which is the paper's Fig. 10 (derivative on error). With the derivative on measurement, e is replaced by -y in d.
"""

from __future__ import annotations

from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.errors import ParameterError
from amb_core.parameters import Parameters, choice, quantity


class ControllerParameters(Parameters):
    """Parameters of the PD controller, the same on both axes (paper, table 1)."""

    sample_rate: float = quantity(10_000.0, "Hz", "controller sample rate f_s", 1_000.0, 100_000.0)
    proportional_gain: float = quantity(20_000.0, "A/m", "proportional gain K_P", 0.0, 1e6, runtime=True)
    derivative_gain: float = quantity(38.0, "A s/m", "derivative gain K_D", 0.0, 1e4, runtime=True)
    derivative_filter: float = quantity(
        0.0, "s", "time constant of the first-order filter on the derivative; 0 for none", 0.0, 0.1, runtime=True
    )
    derivative_on: Literal["error", "measurement"] = choice(
        "error", "signal that is differentiated: the position error (paper, Fig. 10) or the measured position"
    )
    current_limit: float = quantity(
        3.0, "A", "limit on the magnitude of the control current references", 0.0, 100.0, runtime=True
    )
    nominal_reference_x: float = quantity(0.0, "m", "nominal reference position, x axis", -1e-3, 1e-3, runtime=True)
    nominal_reference_y: float = quantity(0.0, "m", "nominal reference position, y axis", -1e-3, 1e-3, runtime=True)


STATE_SIZE = 5  # derivative x, y; previous differentiated signal x, y; 1.0 once the previous signal is known


@numba.njit(cache=True)
def pd_update(
    state: NDArray[np.float64],
    gains: NDArray[np.float64],
    x: float,
    y: float,
    reference_x: float,
    reference_y: float,
    current: NDArray[np.float64],
) -> None:
    """Advance the control law by one sample.

    Parameters
    ----------
    state : ndarray, shape (5,)
        State of the law, changed in place; all zero before the first sample.
    gains : ndarray, shape (6,)
        From `pack_gains`.
    x, y, reference_x, reference_y : float
        Measured position and reference position (m).
    current : ndarray, shape (2,)
        Receives the control current references (A).
    """
    proportional, derivative, keep, weight, on_error, limit = gains
    for axis in range(2):
        measured = x if axis == 0 else y
        reference = reference_x if axis == 0 else reference_y
        differentiated = on_error * reference - measured
        if state[4] == 0.0:
            state[2 + axis] = differentiated
        state[axis] = keep * state[axis] + weight * (differentiated - state[2 + axis])
        state[2 + axis] = differentiated
        current[axis] = min(max(proportional * (reference - measured) + derivative * state[axis], -limit), limit)
    state[4] = 1.0


def require_one_rate(parameters: ControllerParameters, sample_rate: float) -> None:
    """Raise ParameterError unless the controller runs at the sample rate of the plant (Hz)."""
    if abs(parameters.sample_rate - sample_rate) > 1e-9 * sample_rate:
        raise ParameterError(
            f"the controller runs at {parameters.sample_rate:g} Hz, the plant is sampled at {sample_rate:g} Hz; "
            "the two rates must be equal"
        )


def pack_gains(parameters: ControllerParameters) -> NDArray[np.float64]:
    """Coefficients of `pd_update`: K_P, K_D, filter pole, difference weight, 1 for derivative on error, limit."""
    sample_time = 1.0 / parameters.sample_rate
    span = parameters.derivative_filter + sample_time
    return np.array(
        [
            parameters.proportional_gain,
            parameters.derivative_gain,
            parameters.derivative_filter / span,
            1.0 / span,
            1.0 if parameters.derivative_on == "error" else 0.0,
            parameters.current_limit,
        ]
    )


class PdController:
    """The control law with its state: one call of `update` per controller sample."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._state = np.zeros(STATE_SIZE)
        self._current = np.zeros(2)
        self.configure(parameters)

    def configure(self, parameters: ControllerParameters) -> None:
        """Use new gains from the next sample onwards; the state is kept."""
        self.parameters = parameters
        self._gains = pack_gains(parameters)

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""
        self._state[:] = 0.0

    def update(self, x: float, y: float, reference_x: float, reference_y: float) -> tuple[float, float]:
        """Control current references (A) for a measured position and a reference position (m)."""
        pd_update(self._state, self._gains, x, y, reference_x, reference_y, self._current)
        return float(self._current[0]), float(self._current[1])
