"""Poles that are closer together than the data determine them, taken as a group.

A multiple pole has no derivative, and a pair of close poles has one only for changes much smaller than its distance. A
gyroscopic rotor has such pairs: a real pair of one estimate is a complex pair of the next. What does change linearly is
the matrix of the group: with bases V and W' of its right and left invariant subspaces, W' V = I,

    F = W' A V,    dF = W' dA V,    poles of the group = eigenvalues of F.

So a value z belongs to the confidence region of the group if the likeliest F that has the eigenvalue z is close enough:
with (F_0 + dF) v = z v, which is linear in dF for a given v,

    distance(z) = min over v, dF of the norm of xi,  dF = sum_i xi_i W' dA_i V,

which is the profile of the likelihood; its square is compared with chi-square of one degree of freedom for a real z,
of two for a complex one. A pole far from all others is a group of one, with the usual interval or ellipse.

Sources: G. W. Stewart and J. Sun, Matrix Perturbation Theory, Academic Press, 1990, section V.2; S. S. Wilks, Annals of
Mathematical Statistics 9 (1938).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.special import gammaincinv

Complexes = NDArray[np.complex128]
Arrays = NDArray[np.float64]

SECOND = 0.1
"""Second-order change over first-order deviation from which two poles are taken together."""
_STARTS = 64
_BEST = 4  # starts from which a distance is searched
_STEPS = 30
_SOLVED = 1e-9  # residual at most, relative, of a change that gives the eigenvalue


@dataclass(frozen=True, eq=False)
class PoleGroup:
    """Poles of an estimate with their joint distribution.

    Attributes
    ----------
    poles : ndarray of complex, shape (r,)
        Estimated poles, z plane.
    matrix : ndarray, shape (r, r)
        F_0: real if the complex conjugates belong to the group too, otherwise complex.
    changes : ndarray, shape (k, r, r)
        Independent changes of it, each by one standard deviation.
    """

    poles: Complexes
    matrix: NDArray[np.complex128] | Arrays
    changes: NDArray[np.complex128] | Arrays

    @property
    def real(self) -> bool:
        """Whether the group is its own complex conjugate."""
        return not np.iscomplexobj(self.matrix)

    def distance(self, pole: complex, enough: float = 0.0) -> float:
        """Distance of a value from the estimate in standard deviations: of the nearest F with this eigenvalue.

        Infinite if no F of the group has it, such as a complex value for a single real pole. The search ends at the
        first F that is not farther than `enough`.
        """
        from scipy.optimize import minimize  # takes a quarter of a second to import

        size = len(self.matrix)
        by_real = self.real and complex(pole).imag == 0.0
        shifted = (pole.real if by_real else pole) * np.eye(size) - self.matrix

        def squared(vectors: NDArray[np.complex128] | Arrays) -> Arrays:
            vectors = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
            moved = _parts(np.einsum("kij,sj->sik", self.changes, vectors), by_real, axis=1)
            wanted = _parts(vectors @ shifted.T, by_real, axis=1)
            factors = (np.linalg.pinv(moved) @ wanted[:, :, np.newaxis])[:, :, 0]
            missed = np.linalg.norm((moved @ factors[:, :, np.newaxis])[:, :, 0] - wanted, axis=1)
            scale = np.linalg.norm(wanted, axis=1) + np.finfo(float).tiny
            return np.where(missed <= _SOLVED * scale, np.sum(factors**2, axis=1), np.inf)

        def vector(unknown: Arrays) -> NDArray[np.complex128] | Arrays:
            return unknown if by_real else unknown[:size] + 1j * unknown[size:]

        if size == 1:
            return float(np.sqrt(squared(np.ones((1, 1)))[0]))
        random = np.random.default_rng(0)
        starts = random.normal(size=(_STARTS, size if by_real else 2 * size))
        rough = squared(np.array([vector(start) for start in starts]))
        best = float(rough.min())
        for place in np.argsort(rough)[:_BEST]:
            if best > enough**2 and math.isfinite(rough[place]):
                search = minimize(lambda at: float(squared(vector(at)[np.newaxis])[0]), starts[place], method="BFGS")
                best = min(best, float(search.fun))
        return math.sqrt(best)

    def holds(self, pole: complex, confidence: float) -> bool:
        """Whether a value lies in the confidence region of the group's poles."""
        freedom = 1 if self.real and complex(pole).imag == 0.0 else 2
        limit = math.sqrt(2.0 * gammaincinv(0.5 * freedom, confidence))  # quantile of chi^2
        return self._at_least(pole) <= limit and self.distance(pole, limit) <= limit

    def _at_least(self, pole: complex) -> float:
        """A bound of `distance` from below, without a search: the least change of F that gives it the eigenvalue."""
        per_deviation = np.linalg.norm(self.changes.reshape(len(self.changes), -1), 2)
        needed = np.linalg.norm(pole * np.eye(len(self.matrix)) - self.matrix, -2)
        return float(needed / max(per_deviation, np.finfo(float).tiny))

    def magnitudes(self, radius: float) -> tuple[float, float]:
        """Smallest and largest magnitude of a pole of the group within so many standard deviations."""
        return -self._largest(-1.0, radius), self._largest(1.0, radius)

    def _largest(self, sign: float, radius: float) -> float:
        """The largest of sign times the magnitude of a pole over the ellipsoid, by steps along the gradient."""
        random = np.random.default_rng(0)
        at = random.normal(size=(_STARTS, len(self.changes)))
        best = -np.inf
        for _ in range(_STEPS):
            at *= radius / (np.linalg.norm(at, axis=1, keepdims=True) + np.finfo(float).tiny)
            values, right = np.linalg.eig(self.matrix + np.tensordot(at, self.changes, axes=1))
            place = np.argmax(sign * np.abs(values), axis=1)
            every = np.arange(len(at))
            chosen = values[every, place]
            best = max(best, float((sign * np.abs(chosen)).max()))
            left = np.linalg.pinv(right)[every, place]
            slope = np.einsum("si,kij,sj->sk", left, self.changes, right[every, :, place])
            at = sign * (slope * (chosen.conj() / (np.abs(chosen) + np.finfo(float).tiny))[:, np.newaxis]).real
        return best


def pole_groups(a: Arrays, changes: Arrays) -> list[PoleGroup]:
    """The poles of a matrix, those together whose derivatives fail; groups with the largest magnitudes first.

    By second-order perturbation pole i moves by c_ij c_ji / (pole_i - pole_j) through pole j, where c = W' dA V is
    the change of the matrix in the coordinates of its eigenvectors. Two poles are taken together if this is not small
    against the first-order deviations of both.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        A.
    changes : ndarray, shape (q, n, n)
        Independent changes of it, each by one standard deviation.
    """
    poles, right = np.linalg.eig(a)
    order = np.argsort(-np.abs(poles), kind="stable")
    poles, right = poles[order].astype(np.complex128), right[:, order]
    moved = np.einsum("in,qnm,mj->qij", np.linalg.pinv(right), changes, right, optimize=True)
    size = np.sqrt(np.sum(np.abs(moved) ** 2, axis=0))
    apart = np.abs(poles[:, np.newaxis] - poles)
    first = np.maximum(np.diagonal(size)[:, np.newaxis], np.diagonal(size))
    close = size * size.T >= SECOND * apart * first
    left = list(range(len(poles)))
    groups = []
    while left:
        members = [left.pop(0)]
        for member in members:
            joined = [other for other in left if close[member, other]]
            members += joined
            left = [other for other in left if other not in joined]
        groups.append(_group(a, changes, poles, sorted(members)))
    return groups


def _group(a: Arrays, changes: Arrays, poles: Complexes, members: Sequence[int]) -> PoleGroup:
    inside = poles[list(members)]
    others = np.delete(poles, list(members))
    real = bool(np.abs(inside.conj()[:, np.newaxis] - inside).min(axis=1).max() <= 1e-9 * np.abs(inside).max())

    def belongs(value: complex) -> bool:
        return bool(np.abs(inside - value).min() < np.abs(others - value).min(initial=np.inf))

    right, left = _basis(a, belongs, real, len(inside)), _basis(a.T, belongs, real, len(inside))
    left = np.linalg.solve(left.T @ right, left.T)  # W' with W' V = I
    moved = np.einsum("in,qnm,mj->qij", left, changes, right, optimize=True)
    flat = _parts(moved.reshape(len(changes), -1), real, axis=1)
    _, size, axes = np.linalg.svd(flat, full_matrices=False)
    axes = axes[size > 1e-12 * size.max(initial=0.0)] * size[size > 1e-12 * size.max(initial=0.0), np.newaxis]
    half = len(inside) ** 2
    whole = np.asarray(axes if real else axes[:, :half] + 1j * axes[:, half:])
    return PoleGroup(inside, left @ a @ right, whole.reshape(-1, len(inside), len(inside)))


def _basis(a: Arrays, belongs, real: bool, size: int):  # type: ignore[no-untyped-def]
    """An orthonormal basis of the invariant subspace of some poles of A, shape (n, r)."""
    if real:
        return linalg.schur(a, output="real", sort=lambda x, y=0.0: belongs(complex(x, y)))[1][:, :size]
    return linalg.schur(a, output="complex", sort=belongs)[1][:, :size]


def _parts(values: NDArray[np.complex128] | Arrays, real: bool, axis: int) -> Arrays:
    """Real parts, followed by imaginary parts unless all is real."""
    return np.asarray(values.real if real else np.concatenate([values.real, values.imag], axis=axis))
