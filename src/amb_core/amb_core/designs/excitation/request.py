"""What the linear loop requests of the amplifiers under an excitation, compared with their limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.excitation.linear_response import LinearResponse


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
    limit : float
        Limit of the control current (A).
    slew_rate : float
        Fastest change of the current that the voltage drives (A/s); infinite without limits.
    """

    static: float
    current: NDArray[np.float64]
    slew: NDArray[np.float64]
    limit: float
    slew_rate: float

    @property
    def limited(self) -> float:
        """Share of the samples in which the current, the static one included, is above its limit."""
        return float(np.mean(np.abs(self.static + self.current) > self.limit))

    @property
    def slewed(self) -> float:
        """Share of the samples in which the current changes faster than the voltage can drive it."""
        return float(np.mean(np.abs(self.slew) > self.slew_rate))

    def current_margin(self, share: float) -> float:
        """Factor on the excitation at which that share of the samples is above the limit of the current."""
        room = np.maximum(self.limit - np.sign(self.current) * self.static, 0.0)
        return _quantile(room, np.abs(self.current), share)

    def slew_margin(self, share: float) -> float:
        """Factor on the excitation at which that share of the samples is beyond the slew rate."""
        return _quantile(np.full(len(self.slew), self.slew_rate), np.abs(self.slew), share)


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
    current = linear.current[slice(*span), axis]
    return Request(float(static_current[axis]), current, slew, limit, np.inf if slew_rate is None else slew_rate)


def _quantile(room: NDArray[np.float64], requested: NDArray[np.float64], share: float) -> float:
    """Factor on requests at which a share of them exceeds its room; infinite where fewer are not zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.where(requested > 0.0, room / requested, np.inf)
    return float(np.quantile(factors, share, method="higher"))
