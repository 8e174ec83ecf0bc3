"""The exact peak of the gain of a linear discrete-time system.

The peak is the L-infinity norm, found by the Hamiltonian eigenvalues of SLICOT's AB13DD and not on a grid; a bounded
search around the frequency that it gives brings the value to rounding. AB13DD takes the system in the plane of the
bilinear transform, which keeps the peak: the symplectic eigenvalues of the discrete system are of less accuracy, and
miss peaks of loops with identified models by up to a quarter. The eigenvalues also lose their accuracy in states of
very different sizes, such as those of axes in different units: states are balanced before, and the result is compared
with the response at the angles of the poles and on a coarse grid.

Source: N. A. Bruinsma and M. Steinbuch, A fast algorithm to compute the H-infinity norm of a transfer function matrix,
Systems and Control Letters 14 (1990); P. Benner, V. Sima and M. Voigt, L-infinity-norm computation for continuous-time
descriptor systems using structured matrix pencils, IEEE Transactions on Automatic Control 57 (2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import ctrlsys
import numpy as np

from amb_core.ground.errors import RobustnessError
from amb_core.ground.given_values import require_kind
from amb_core.linear.system import Arrays, LinearSystem

_TOLERANCE = 1e-9  # of AB13DD, relative
_NEIGHBOURHOOD = 1e-4  # about the frequency of a peak, relative, in which its value is refined at first
_WIDENINGS = 12
_COARSE, _LOWEST = 100, 1e-5  # frequencies of the comparison, from this share of half the sample rate


@dataclass(frozen=True)
class Peak:
    """A largest gain and where it is.

    Attributes
    ----------
    value : float
        Largest singular value over all frequencies (units of the transfer).
    frequency : float
        Where it is (Hz).
    """

    value: float
    frequency: float


def peak_gain(system: LinearSystem) -> Peak:
    """Largest singular value of a system over all frequencies.

    Parameters
    ----------
    system : LinearSystem
        System in discrete time. Of an unstable one it is the L-infinity norm; see `h_infinity_norm`.

    Returns
    -------
    Peak
        The value, in the unit of the response, and its frequency (Hz).

    Raises
    ------
    RobustnessError
        If the system is in continuous time, a matrix holds values that are not finite, a pole lies on the unit circle,
        or SLICOT fails.
    """
    _require_discrete(system)
    half = 0.5 / system.sample_time
    if not system.order:
        return Peak(float(np.linalg.norm(system.d, 2)), 0.0)
    system = system.balanced()
    if np.any(np.abs(np.abs(system.poles()) - 1.0) < 1e-12):
        raise RobustnessError("the gain has no largest value: a pole lies on the unit circle")
    a, b, c, d = (np.asfortranarray(matrix) for matrix in _bilinear(system))
    n, m, p = system.order, b.shape[1], len(c)
    gain, at, info = ctrlsys.ab13dd(
        "C", "I", "S", "D", n, m, p, np.array([0.0, 1.0]), a, np.asfortranarray(np.eye(n)), b, c, d, _TOLERANCE
    )
    if info != 0 or not gain[1]:
        raise RobustnessError(f"SLICOT finds no largest gain (AB13DD, info {info}, {gain})")
    frequency = 2.0 * math.atan2(at[0], at[1]) / math.pi * half
    top = _refined(system, min(max(frequency, 0.0), half), float(gain[0] / gain[1]))
    angles = np.abs(np.angle(system.poles())) / np.pi * half
    coarse = np.concatenate([[0.0], np.geomspace(_LOWEST * half, half, _COARSE), angles])
    gains = np.linalg.norm(system.response(coarse), 2, axis=(1, 2))
    highest = int(np.argmax(gains))
    if gains[highest] > top.value * (1.0 + _TOLERANCE):
        top = max(top, _refined(system, float(coarse[highest]), float(gains[highest])), key=lambda peak: peak.value)
    return top


def _require_discrete(system: LinearSystem) -> None:
    require_kind("system", system, LinearSystem, "a LinearSystem", RobustnessError)
    if not system.sample_time > 0.0:
        raise RobustnessError(
            f"system: a sample time of {system.sample_time:g} s is not allowed; allowed: a system in discrete time"
        )
    for name in "abcd":
        if not np.all(np.isfinite(getattr(system, name))):
            raise RobustnessError(f"system: {name.upper()} holds values that are not finite")


def _bilinear(system: LinearSystem) -> tuple[Arrays, Arrays, Arrays, Arrays]:
    """The system in s of z = (1 + s)/(1 - s); on the unit circle s = j tan(w T/2), infinite at half the sample rate."""
    inverse = np.linalg.inv(np.eye(system.order) + system.a)
    b, c = inverse @ system.b, system.c @ inverse
    a = inverse @ (system.a - np.eye(system.order))
    return a, math.sqrt(2.0) * b, math.sqrt(2.0) * c, system.d - system.c @ b


def h_infinity_norm(system: LinearSystem) -> float:
    """Largest singular value of a system over all frequencies; infinite if it is not stable.

    Parameters
    ----------
    system : LinearSystem
        System in discrete time.

    Returns
    -------
    float
        The norm, in the unit of the response.

    Raises
    ------
    RobustnessError
        As for `peak_gain`, except for poles on the unit circle.
    """
    _require_discrete(system)
    return peak_gain(system).value if system.radius < 1.0 else math.inf


def _refined(system: LinearSystem, frequency: float, value: float) -> Peak:
    """The top of the peak at a frequency: AB13DD stops within its tolerance below it."""
    from scipy.optimize import minimize_scalar  # takes a quarter of a second to import

    half = 0.5 / system.sample_time
    width = max(_NEIGHBOURHOOD * frequency, 1e-9 * half)
    middle = frequency
    for _ in range(_WIDENINGS):  # until the neighbourhood holds a maximum inside it, not at its end
        low, high = max(0.0, middle - width), min(half, middle + width)
        ends = system.gain(low), system.gain(high)
        if max(ends) <= system.gain(middle):
            break
        middle, width = (low, high)[int(np.argmax(ends))], 2.0 * width
    optimum = minimize_scalar(
        lambda at: -system.gain(at), bounds=(low, high), method="bounded", options={"xatol": 1e-7 * width}
    )
    best = max((system.gain(at), at) for at in (frequency, float(optimum.x), low, high))
    return Peak(*best) if best[0] >= value * (1.0 - 1e-7) else Peak(value, frequency)
