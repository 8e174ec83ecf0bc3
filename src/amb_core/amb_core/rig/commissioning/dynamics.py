"""Gain, delay and low-pass of each axis, from its response to tones: on the backup bearing, and levitated.

With the plant P of the model, a wrong gain g, a further delay tau, a further low-pass and contact of stiffness k and
damping c with the backup bearing, the response H from currents to positions has

    (H^-1)_jj exp(-j w tau) / (P^-1)_jj = (1 + s T) / g + (a + c s) / (s^2 - p^2),

with p the unstable pole of the plant: for each tau a linear equation for 1/g, T/g, a and c. Levitated, c = 0 and a is
the error of the stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

DELAYS = np.arange(-3.0, 15.01, 0.1)
"""Delays that are tried (samples)."""


@dataclass(frozen=True)
class AxisDynamics:
    """Of one axis, relative to the model.

    Attributes
    ----------
    gain : float
        At high frequency, where mass and force decide (-).
    static_gain : float
        At frequency zero, where force and negative stiffness decide (-).
    gain_error : float
        Relative standard deviation of the gain (-).
    delay : float
        Further delay (samples).
    delay_error : float
        Standard deviation of it (samples).
    lag : float
        Time constant of a further low-pass instead of the delay (s).
    misfit : tuple of float
        Relative residual, rms, with a delay and with a low-pass.
    """

    gain: float
    static_gain: float
    gain_error: float
    delay: float
    delay_error: float
    lag: float
    misfit: tuple[float, float]


def axis_dynamics(
    inverse: NDArray[Any],
    model: NDArray[Any],
    frequency: NDArray[np.float64],
    error: NDArray[np.float64],
    pole: float,
    sample_time: float,
    contact: bool,
) -> AxisDynamics:
    """Fit the equation above, with a gain above zero: the sign is known before.

    Parameters
    ----------
    inverse, model : ndarray of complex, shape (tones,)
        (H^-1)_jj measured and (P^-1)_jj of the model (A/m).
    frequency : ndarray, shape (tones,)
        (Hz).
    error : ndarray, shape (tones,)
        Relative standard deviation of `inverse`.
    pole : float
        p (1/s).
    sample_time : float
        (s).
    contact : bool
        Whether the rotor lies on its backup bearing.
    """
    s = 2j * np.pi * frequency
    ratio, form = inverse / model, 1.0 / (s**2 - pole**2)
    weight = 1.0 / (np.abs(ratio) * np.hypot(error, 0.01))
    ones = np.ones_like(s)
    columns = [ones, form, s * form] if contact else [ones, form]

    def solved(columns: Sequence[NDArray[Any]], right: NDArray[Any]) -> tuple[NDArray[np.float64], float]:
        rows, values = weight[:, np.newaxis] * np.column_stack(columns), weight * right
        both = np.vstack([rows.real, rows.imag])
        wanted = np.concatenate([values.real, values.imag])
        solution = np.linalg.lstsq(both, wanted, rcond=None)[0]
        return solution, float(np.sum((both @ solution - wanted) ** 2))

    turned = [solved(columns, ratio * np.exp(-s * delay * sample_time)) for delay in DELAYS]
    # With a wrong sign and a delay of half a period of the high tones the equation holds almost as well.
    cost = np.array([left if solution[0] > 0.0 else np.inf for solution, left in turned])
    best = int(np.argmin(cost))
    solution = turned[best][0]
    rows = weight[:, np.newaxis] * np.column_stack(columns)
    spreads = np.diag(np.linalg.pinv((rows.conj().T @ rows).real))
    freedom = max(2 * len(frequency) - len(columns) - 1, 1)
    scale = max(cost[best] / freedom, 1.0)
    delay, spread = _vertex(cost, best, scale)
    lagging, left = solved([*columns, s * ones], ratio)
    unit = 1.0 / np.sqrt(np.sum(weight**2 * np.abs(ratio) ** 2))
    static = solution[0] - solution[1] / pole**2 if pole > 0.0 else solution[0]
    return AxisDynamics(
        gain=_inverse(solution[0]),
        static_gain=_inverse(static),
        gain_error=float(np.sqrt(scale * spreads[0]) / max(abs(solution[0]), 1e-300)),
        delay=delay,
        delay_error=spread,
        lag=float(lagging[-1] * _inverse(lagging[0])),
        misfit=(float(np.sqrt(cost[best]) * unit), float(np.sqrt(left) * unit)),
    )


def _vertex(cost: NDArray[np.float64], best: int, scale: float) -> tuple[float, float]:
    """Delay at the minimum of a parabola, and its standard deviation (samples)."""
    if not (0 < best < len(cost) - 1 and np.isfinite(cost[best - 1 : best + 2]).all()):
        return float(DELAYS[best]), np.inf
    step = DELAYS[1] - DELAYS[0]
    curve = (cost[best - 1] - 2.0 * cost[best] + cost[best + 1]) / step**2
    slope = (cost[best + 1] - cost[best - 1]) / (2.0 * step)
    return float(DELAYS[best] - slope / curve), float(np.sqrt(2.0 * scale / max(curve, 1e-300)))


def _inverse(value: float) -> float:
    return float(1.0 / value) if value else np.inf
