"""What the linear loop requests of the amplifiers under an excitation, compared with their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation_design.linear_response import LinearResponse


@dataclass(frozen=True)
class Request:
    """The control current that the linear loop requests on an axis while that is excited.

    Attributes
    ----------
    static : float
        What holds the rotor at rest (A).
    current : ndarray, shape (steps,)
        What the excitation adds, without any limit (A).
    slew : ndarray, shape (steps,)
        Its change over a sample (A/s).
    slewed : float
        Share of the samples in which it changes faster than the voltage can drive it.
    limit : float
        Limit of the control current (A).
    """

    static: float
    current: NDArray[np.float64]
    slew: NDArray[np.float64]
    slewed: float
    limit: float


def request_on(
    axis: int,
    span: tuple[int, int],
    linear: LinearResponse,
    static_current: NDArray[np.float64],
    limit: float,
    slew_rate: float | None,
    sample_time: float,
) -> Request:
    """The request on an axis.

    Parameters
    ----------
    axis : int
        0 for x, 1 for y.
    span : tuple of int
        First step at which the axis is excited, and the step after the last.
    linear : LinearResponse
        Of the linear loop to the whole signal.
    static_current : ndarray, shape (2,)
        Control currents at rest (A).
    limit, slew_rate : float
        Limits of the control current (A, A/s); a slew rate of None is no limit.
    sample_time : float
        Sample time (s).
    """
    slew = np.diff(linear.current[:, axis], prepend=0.0)[slice(*span)] / sample_time
    slewed = 0.0 if slew_rate is None else float(np.mean(np.abs(slew) > slew_rate))
    return Request(float(static_current[axis]), linear.current[slice(*span), axis], slew, slewed, limit)
