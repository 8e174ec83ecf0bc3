"""Linear discrete-time systems for robustness: state space, frequency response, exact peak of the gain.

The peak is the L-infinity norm, found by the symplectic eigenvalues of SLICOT's AB13DD and not on a grid; a bounded
search around the frequency that it gives brings the value to rounding. The eigenvalues lose their accuracy in states of
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
from numpy.typing import NDArray
from scipy.linalg import matrix_balance
from scipy.optimize import minimize_scalar

from amb_core.errors import RobustnessError

Arrays = NDArray[np.float64]
Complexes = NDArray[np.complex128]

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


@dataclass(frozen=True, eq=False)
class Lti:
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k].

    Attributes
    ----------
    a, b, c, d : ndarray, shapes (n, n), (n, m), (p, n), (p, m)
        Matrices.
    sample_time : float
        Sample time (s).
    """

    a: Arrays
    b: Arrays
    c: Arrays
    d: Arrays
    sample_time: float

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.a)

    def poles(self) -> Complexes:
        """Poles in the z plane, largest magnitude first, shape (n,)."""
        poles = np.linalg.eigvals(self.a).astype(np.complex128)
        return np.asarray(poles[np.argsort(-np.abs(poles), kind="stable")])

    @property
    def radius(self) -> float:
        """Largest magnitude of a pole; 0 without states."""
        return float(np.abs(self.poles()).max(initial=0.0))

    def response(self, frequency: Arrays) -> Complexes:
        """Frequency response at frequencies in Hz, shape (f, p, m); infinite at a pole on the unit circle."""
        z = np.exp(2j * np.pi * np.asarray(frequency) * self.sample_time)
        if not self.order:
            return np.broadcast_to(self.d.astype(np.complex128), (len(z), *self.d.shape)).copy()
        shifted = z[:, np.newaxis, np.newaxis] * np.eye(self.order) - self.a
        try:
            return np.asarray(self.c @ np.linalg.solve(shifted, self.b.astype(np.complex128)[np.newaxis]) + self.d)
        except np.linalg.LinAlgError:  # at one of the frequencies; the others one by one
            if len(z) == 1:
                return np.full((1, *self.d.shape), np.inf, dtype=np.complex128)
            return np.concatenate([self.response(np.atleast_1d(one)) for one in np.asarray(frequency)])

    def balanced(self) -> Lti:
        """The same system with states of similar size: the columns and rows of [A B; C 0] have similar norms."""
        n = self.order
        if not n or not (np.any(self.b) and np.any(self.c)):
            return self
        whole = np.zeros((n + 1, n + 1))  # inputs together and outputs together as one signal
        whole[:n, :n] = self.a
        whole[:n, n], whole[n, :n] = np.linalg.norm(self.b, axis=1), np.linalg.norm(self.c, axis=0)
        # As one signal they are balanced first: else the states' sizes would depend on the units of a gain.
        whole[n] *= np.linalg.norm(whole[:n, n]) / np.linalg.norm(whole[n])
        scale = matrix_balance(whole, permute=False, separate=True)[1][0][:n]
        if not np.all(np.isfinite(scale)) or np.any(scale <= 0.0):
            return self
        return Lti(
            self.a * scale / scale[:, np.newaxis],
            self.b / scale[:, np.newaxis],
            self.c * scale,
            self.d,
            self.sample_time,
        )

    def part(self, outputs: list[int] | slice, inputs: list[int] | slice) -> Lti:
        """The system with some of its outputs and inputs."""
        return Lti(self.a, self.b[:, inputs], self.c[outputs], self.d[outputs][:, inputs], self.sample_time)

    def plus(self, matrix: Arrays) -> Lti:
        """The system with a constant matrix added."""
        return Lti(self.a, self.b, self.c, self.d + matrix, self.sample_time)

    def gain(self, frequency: float) -> float:
        """Largest singular value at a frequency (Hz)."""
        return float(np.linalg.norm(self.response(np.array([frequency]))[0], 2))


def peak_gain(system: Lti) -> Peak:
    """Largest singular value of a system over all frequencies.

    Raises
    ------
    RobustnessError
        If a pole lies on the unit circle, or SLICOT fails.
    """
    half = 0.5 / system.sample_time
    if not system.order:
        return Peak(float(np.linalg.norm(system.d, 2)), 0.0)
    system = system.balanced()
    if np.any(np.abs(np.abs(system.poles()) - 1.0) < 1e-12):
        raise RobustnessError("the gain has no largest value: a pole lies on the unit circle")
    a, b, c, d = (np.asfortranarray(matrix, dtype=float) for matrix in (system.a, system.b, system.c, system.d))
    n, m, p = system.order, b.shape[1], len(c)
    # Of discrete systems AB13DD takes and gives frequencies as angles in rad, whatever the sample time.
    gain, at, info = ctrlsys.ab13dd(
        "D", "I", "S", "D", n, m, p, np.array([0.0, 1.0]), a, np.asfortranarray(np.eye(n)), b, c, d, _TOLERANCE
    )
    if info != 0 or not gain[1]:
        raise RobustnessError(f"SLICOT finds no largest gain (AB13DD, info {info}, {gain})")
    frequency = float(at[0] / at[1]) / (2.0 * math.pi) * 2.0 * half if at[1] else half
    found = _refined(system, min(max(frequency, 0.0), half), float(gain[0] / gain[1]))
    angles = np.abs(np.angle(system.poles())) / np.pi * half
    coarse = np.concatenate([[0.0], np.geomspace(_LOWEST * half, half, _COARSE), angles])
    gains = np.linalg.norm(system.response(coarse), 2, axis=(1, 2))
    top = int(np.argmax(gains))
    if gains[top] > found.value * (1.0 + _TOLERANCE):
        found = max(found, _refined(system, float(coarse[top]), float(gains[top])), key=lambda peak: peak.value)
    return found


def _refined(system: Lti, frequency: float, value: float) -> Peak:
    """The top of the peak at a frequency: AB13DD stops within its tolerance below it."""
    half = 0.5 / system.sample_time
    width = max(_NEIGHBOURHOOD * frequency, 1e-9 * half)
    middle = frequency
    for _ in range(_WIDENINGS):  # until the neighbourhood holds a maximum inside it, not at its end
        low, high = max(0.0, middle - width), min(half, middle + width)
        ends = system.gain(low), system.gain(high)
        if max(ends) <= system.gain(middle):
            break
        middle, width = (low, high)[int(np.argmax(ends))], 2.0 * width
    found = minimize_scalar(
        lambda at: -system.gain(at), bounds=(low, high), method="bounded", options={"xatol": 1e-7 * width}
    )
    best = max((system.gain(at), at) for at in (frequency, float(found.x), low, high))
    return Peak(*best) if best[0] >= value * (1.0 - 1e-7) else Peak(value, frequency)
