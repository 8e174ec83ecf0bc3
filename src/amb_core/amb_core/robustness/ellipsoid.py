"""Worst cases over the confidence ellipsoid of an identified model.

The estimate is normal: theta = theta_0 + R xi. At each frequency the plant's response is linear in xi,

    P(omega; xi) = P_0 + sum_i xi_i dP_i,    |xi| <= rho,

and any closed-loop transfer is M = M_0 + M_zy dP (I - W dP)^-1 M_uw, W = -C S_o, without iteration or simulation. Its
largest singular value is maximised over the ellipsoid by its gradient: the step to rho g/|g| is that of Frank and
Wolfe, repeated from several starts. The maximum over frequency and over the ellipsoid commute, so the result is the
worst peak over all models of the ellipsoid.

Two sizes of the ellipsoid answer two questions. With rho the normal quantile the bound holds, at the confidence, for
that one number (a profile of the likelihood: Wilks), or for a few numbers together if the confidence is shared among
them; with rho^2 the quantile of chi^2 with as many degrees of freedom
as the model has parameters, for all numbers and all frequencies at once (Bombois and Gevers).

Sources: X. Bombois, M. Gevers, G. Scorletti and B. D. O. Anderson, Robustness analysis tools for an uncertainty set
obtained by prediction error identification, Automatica 37 (2001); G. Vinnicombe, Frequency domain uncertainty and the
graph topology, IEEE Transactions on Automatic Control 38 (1993); S. S. Wilks, Annals of Mathematical Statistics 9
(1938).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from amb_core.identification.frequency_response import normal_quantile, transfers
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.uncertainty.directions import response_changes
from amb_core.linear import Arrays, Complexes
from amb_core.linear.peak import Peak
from amb_core.robustness.feedback import Feedback

Places = NDArray[np.intp]
_STEPS = 15
_FIRST_STEPS = 5  # at all frequencies
_STARTS = 4  # the gradient at the estimate, its opposite, and random ones
_HIGH = 0.8  # of the largest value: frequencies at which all starts are tried

Objective = Callable[[Complexes, Places], tuple[Arrays, Complexes]]
"""From dP, shape (f, p, m), at some of the frequencies, to the value (f,) and to G (f, p, m) with d value = Re sum
conj(G) d(dP)."""


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst case over an ellipsoid.

    Attributes
    ----------
    value, frequency : float
        Largest value over all models, and its frequency (Hz).
    curve : ndarray, shape (f,)
        Largest value at each frequency.
    factors : ndarray, shape (q,)
        xi of the worst model, for `ModelUncertainty.moved`.
    """

    value: float
    frequency: float
    curve: Arrays
    factors: Arrays

    def at_least(self, peak: Peak) -> Worst:
        """The same, no lower than an exact peak of the model itself: it may lie between frequencies of the search."""
        return self if self.value >= peak.value else replace(self, value=peak.value, frequency=peak.frequency)


@dataclass(frozen=True, eq=False)
class PlantSet:
    """The responses of all models of an ellipsoid of radius 1, at some frequencies.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    nominal : ndarray of complex, shape (f, p, m)
        P_0.
    axes : ndarray, shape (f, 2 p m, k)
        Real and imaginary parts of dP, row by row, along the k semi-axes of the responses' ellipsoid.
    into : ndarray, shape (f, k, q)
        From the semi-axes back to xi: rows of unit length.
    error : ndarray, shape (f,)
        Size of a further change D of the response that is no change of the parameters: Frobenius norm of D N.
    without : ndarray of complex, shape (f, m, m)
        Pseudo-inverses of N: a loop sees no more of D than D N.
    """

    frequency: Arrays
    nominal: Complexes
    axes: Arrays
    into: Arrays
    error: Arrays
    without: Complexes

    @classmethod
    def of(
        cls, uncertainty: ModelUncertainty, frequency: Arrays, error: tuple[Arrays, Complexes] | None = None
    ) -> PlantSet:
        """The responses of the models of an estimate, and of plants that differ by a further error: its size, and N."""
        model, by = uncertainty.model, uncertainty.deviations
        nominal, changes = [], []
        for _, by_state, by_input in transfers(model, frequency, model.b):
            nominal.append(by_state @ model.b + model.d)
            changes.append(response_changes(by_state, by_input, by.a, by.b, by.c, by.d))
        change = np.concatenate(changes)
        flat = change.reshape(len(change), -1, change.shape[-1])
        u, size, into = np.linalg.svd(np.concatenate([flat.real, flat.imag], axis=1), full_matrices=False)
        none = np.zeros(len(frequency)), np.tile(np.eye(model.inputs, dtype=np.complex128), (len(frequency), 1, 1))
        further, weight = none if error is None else error
        return cls(
            frequency,
            np.concatenate(nominal),
            u * size[:, np.newaxis, :],
            into,
            further,
            np.asarray(np.linalg.pinv(weight), dtype=np.complex128),
        )

    @property
    def alone(self) -> PlantSet:
        """The models without further errors."""
        return replace(self, error=np.zeros(len(self.frequency)))

    def change(self, factors: Arrays, places: Places) -> Complexes:
        """DP at some of the frequencies from factors of the semi-axes, shapes (f', k) to (f', p, m)."""
        parts = (self.axes[places] @ factors[:, :, np.newaxis])[:, :, 0]
        half = parts.shape[1] // 2
        return np.asarray((parts[:, :half] + 1j * parts[:, half:]).reshape(-1, *self.nominal.shape[1:]))

    def slope(self, gradient: Complexes, places: Places) -> Arrays:
        """Gradient over the semi-axes, from that over dP."""
        flat = gradient.reshape(len(gradient), 1, -1)
        return (np.concatenate([flat.real, flat.imag], axis=2) @ self.axes[places])[:, 0]

    def worst(self, objective: Objective, radius: float, seed: int = 0) -> Worst:
        """The largest value of an objective over the ellipsoid of a radius."""
        random, (count, _, axes) = np.random.default_rng(seed), self.axes.shape
        best, at = np.full(count, -np.inf), np.zeros((count, axes))

        def climb(start: Arrays, places: Places, steps: int) -> None:
            factors, error = radius * start, np.zeros((len(places), *self.nominal.shape[1:]), dtype=np.complex128)
            for _ in range(steps):
                value, slope = objective(self.change(factors, places) + error, places)
                better = value > best[places]
                best[places[better]], at[places[better]] = value[better], factors[better]
                factors = radius * _unit(self.slope(slope, places))
                without = self.without[places]
                of_product = slope @ without.conj().transpose(0, 2, 1)
                size = np.linalg.norm(of_product, axis=(1, 2)) + np.finfo(float).tiny
                error = of_product * (self.error[places] / size)[:, np.newaxis, np.newaxis] @ without

        every = np.arange(count)
        little = 1e-6 * radius * random.normal(size=(count, axes))  # at the estimate there may be no slope
        first = _unit(self.slope(objective(self.change(little, every), every)[1], every))
        for start in (first, -first):
            climb(start, every, _FIRST_STEPS)
        high = np.flatnonzero(best >= _HIGH * best.max())
        climb(_unit(at[high]), high, _STEPS)
        for _ in range(_STARTS - 2):
            climb(_unit(random.normal(size=(len(high), axes))), high, _STEPS)
        top = int(np.argmax(best))
        return Worst(float(best[top]), float(self.frequency[top]), best, at[top] @ self.into[top])


def radius_of_one(confidence: float, count: int = 1) -> float:
    """Radius for a bound of one number, or of each of `count` numbers so that all bounds hold together (Bonferroni)."""
    return normal_quantile(1.0 - (1.0 - confidence) / count)


def radius_of_all(confidence: float, count: int) -> float:
    """Radius for bounds of everything at once, of a model of `count` parameters; or of a response of so many parts."""
    return float(np.sqrt(2.0 * gammaincinv(0.5 * count, confidence)))


def closed_loop_objective(
    feedback: Feedback, frequency: Arrays, left: Arrays | Complexes, right: Arrays, plus: Arrays
) -> Objective:
    """The gain of left H right + plus, with H the closed loop from (w_u, w_y) to (u, y) of `feedback`.

    Parameters
    ----------
    feedback : Feedback
        The loop of the estimate, stable.
    frequency : ndarray, shape (f,)
        Frequencies (Hz) of the plant set.
    left, right : ndarray, shapes (r, m + p) or (f, r, m + p), and (m + p, c) or (f, m + p, c)
        Signals and weights.
    plus : ndarray, shape (r, c) or (f, r, c)
        Constant, such as -1 for the complementary sensitivity.
    """
    m = feedback.inputs
    closed = feedback.closed.response(frequency)
    loop = closed[:, :m, m:]  # from w_y to u
    nominal = left @ closed @ right + plus
    into, out = left @ closed[:, :, m:], closed[:, :m] @ right

    def objective(change: Complexes, places: Places) -> tuple[Arrays, Complexes]:
        at = loop[places]
        kept = np.linalg.inv(np.eye(m) - at @ change)
        seen = kept @ out[places]
        # d found = L d(dP) R with L = into (1 + dP kept loop), R = kept out.
        size, u, v = _largest(nominal[places] + into[places] @ change @ seen)
        a = (u[:, np.newaxis].conj() @ into[places] @ (np.eye(change.shape[1]) + change @ kept @ at))[:, 0]
        return size, (a[:, :, np.newaxis] * (seen @ v[:, :, np.newaxis].conj())[:, np.newaxis, :, 0]).conj()

    return objective


def gap_objective(nominal: Complexes, scale: float) -> Objective:
    """Chordal distance between P_0 and P_0 + dP, both times `scale`; its largest value is the nu-gap if below 1."""
    p0 = nominal * scale
    right = _inverse_root(np.eye(p0.shape[2]) + p0.conj().transpose(0, 2, 1) @ p0)

    def objective(change: Complexes, places: Places) -> tuple[Arrays, Complexes]:
        moved = p0[places] + change * scale
        left = _inverse_root(np.eye(p0.shape[1]) + moved @ moved.conj().transpose(0, 2, 1))
        size, u, v = _largest(left @ (moved - p0[places]) @ right[places])
        a = (u[:, np.newaxis].conj() @ left)[:, 0]
        b = (right[places] @ v[:, :, np.newaxis].conj())[:, :, 0]
        return size, (a[:, :, np.newaxis] * b[:, np.newaxis, :]).conj() * scale

    return objective


def _largest(matrices: Complexes) -> tuple[Arrays, Complexes, Complexes]:
    """Largest singular values, their left vectors u and rows v of the right ones, shapes (f,), (f, r), (f, c)."""
    if matrices.shape[1:] == (1, 1):
        size = np.abs(matrices[:, 0, 0])
        return size, matrices[:, 0] / (size[:, np.newaxis] + np.finfo(float).tiny), np.ones((len(size), 1), complex)
    u, sizes, v = np.linalg.svd(matrices, full_matrices=False)
    return sizes[:, 0], u[:, :, 0], v[:, 0]


def _inverse_root(matrices: Complexes) -> Complexes:
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors / np.sqrt(values)[:, np.newaxis, :]) @ vectors.conj().transpose(0, 2, 1))


def _unit(vectors: Arrays) -> Arrays:
    return vectors / (np.linalg.norm(vectors, axis=1, keepdims=True) + np.finfo(float).tiny)
