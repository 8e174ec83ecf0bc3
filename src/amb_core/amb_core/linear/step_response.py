"""Natural frequency and damping ratio of the closed loop, measured on a small step of the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError


@dataclass(frozen=True)
class SecondOrder:
    """A dominant pole pair: undamped natural frequency (Hz) and damping ratio (-)."""

    natural_hz: float
    damping_ratio: float


def fit_step_response(response: NDArray[np.float64], sample_time: float) -> SecondOrder:
    """Fit c + exp(-zeta w t) (a cos(w_d t) + b sin(w_d t)), w_d = w sqrt(1 - zeta^2), to the response to a step.

    Amplitude and phase are free, so zeros of the loop (the controller's) do not disturb the poles found.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Position from the step on (m).
    sample_time : float
        Sample time (s).

    Raises
    ------
    IdentificationError
        If the response does not look like an underdamped oscillation.
    """
    from scipy.optimize import curve_fit  # takes a quarter of a second to import

    change = response[-1] - response[0]
    if not np.isfinite(response).all() or change == 0.0:
        raise IdentificationError("the response to the step is constant or not finite; no poles can be fitted")
    scaled = (response - response[0]) / change
    time = np.arange(len(response)) * sample_time
    crossing = np.argmax(scaled > 0.5) * sample_time  # about an eighth of a period into an underdamped response
    start = (-1.0, 0.0, 1.0 / max(crossing, sample_time), 0.5, 1.0)
    try:
        (_, _, rate, damping, _), _ = curve_fit(
            _decay, time, scaled, start, bounds=([-10, -10, 0, 0, -10], [10, 10, np.pi / sample_time, 0.999, 10])
        )
    except RuntimeError as problem:
        raise IdentificationError(f"no pole pair fits the response to the step: {problem}") from None
    return SecondOrder(float(rate / (2.0 * np.pi)), float(damping))


def _decay(
    time: NDArray[np.float64], cosine: float, sine: float, rate: float, damping: float, end: float
) -> NDArray[np.float64]:
    damped = rate * np.sqrt(1.0 - damping**2)
    return end + np.exp(-damping * rate * time) * (cosine * np.cos(damped * time) + sine * np.sin(damped * time))
