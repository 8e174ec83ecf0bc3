"""Structured singular value of blocks: full complex ones, and real numbers that are repeated on the diagonal.

The upper bound is that of `mu_upper` with block scalings. For any T and Hermitian G that commute with the perturbation,
T a number times I for a full complex block and any matrix for a repeated real one, G = 0 for complex blocks,

    mu(M)^2 <= max(0, lambda_max(M~' M~ + j (G M~ - M~' G))),    M~ = T M T^-1.

The lower bound is a perturbation Q with |Q| <= 1, real numbers or dyads x y' on its diagonal, for which M Q has a real
positive eigenvalue. Its search starts from the eigenvectors of the upper bound, where both meet, and at random.

Sources: M. K. H. Fan, A. L. Tits and J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
unmodeled dynamics, IEEE Transactions on Automatic Control 36 (1991); A. Packard and J. C. Doyle, The complex structured
singular value, Automatica 29 (1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from amb_core.linear import Arrays, Complexes

SHARPNESS = (20.0, 200.0, 2_000.0, 20_000.0)
_STEPS = 200
_PROGRAMS = 24  # random starts of the lower bound
_NEAR = (1e-6, 1e-3, 0.05)  # eigenvalues of the upper bound whose eigenvectors are starts, from the largest
_ENOUGH = 1e-5  # relative distance of the bounds that ends the search
_REAL = 1e-8  # imaginary part at most of an eigenvalue that is taken as real


@dataclass(frozen=True)
class Blocks:
    """Sizes of the blocks along the diagonal, and which of them are real numbers times I."""

    sizes: Sequence[int]
    real: Sequence[bool]

    @cached_property
    def parts(self) -> list[tuple[slice, bool]]:
        """Place of each block, and whether it is real."""
        ends = np.cumsum(self.sizes)
        return [
            (slice(int(end) - size, int(end)), real)
            for end, size, real in zip(ends, self.sizes, self.real, strict=True)
        ]


def upper_of_blocks(matrix: Complexes, blocks: Blocks) -> tuple[float, Complexes, Complexes]:
    """The least upper bound found for a matrix, and its scalings T and G, each of shape (n, n)."""
    size = float(np.linalg.norm(matrix, 2))
    eye = np.eye(len(matrix), dtype=np.complex128)
    if size == 0.0:
        return 0.0, eye, 0.0 * eye
    scaled, basis = matrix / size, _basis(blocks)
    best, at = 1.0, np.concatenate([np.zeros(len(basis.of_t)), np.zeros(len(basis.of_g))])
    for sharp in SHARPNESS if len(at) else ():  # one full block has no scalings
        search = minimize(_smooth, at, (scaled, basis, sharp), jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
        value = _bound(scaled, *basis.scalings(search.x))
        if value <= best:
            best, at = value, search.x
    t, g = basis.scalings(at)
    return best * size, t, g * size


def lower_of_blocks(
    matrix: Complexes, blocks: Blocks, upper: tuple[float, Complexes, Complexes], seed: int = 0
) -> tuple[float, Complexes]:
    """A lower bound, and the perturbation Delta, shape (n, n), that makes I - M Delta singular; 0 if none is found."""
    random, n = np.random.default_rng(seed), len(matrix)
    limits: list[tuple[float | None, float | None]] = []
    for part, real in blocks.parts:
        limits += [(-1.0, 1.0)] if real else [(None, None)] * (4 * (part.stop - part.start))
    best, delta = 0.0, np.zeros((n, n), dtype=np.complex128)
    starts = _dual_starts(matrix, blocks, upper, random)
    for number in range(len(starts) + _PROGRAMS):
        start = starts[number] if number < len(starts) else _random_start(blocks, random)
        eigenvalue = _Eigenvalue(matrix, blocks)
        search = minimize(
            lambda at, own=eigenvalue: own.part(at, -1.0), start, jac=True, method="SLSQP", bounds=limits,
            constraints={
                "type": "eq",
                "fun": lambda at, own=eigenvalue: own.at(at)[0].imag,
                "jac": lambda at, own=eigenvalue: own.at(at)[1].imag,
            },
            options={"maxiter": _STEPS, "ftol": 1e-12},
        )  # fmt: skip
        value, q = eigenvalue.at(search.x)[0], _perturbation(blocks, search.x)
        if value.real > best and abs(value.imag) < _REAL * value.real:
            best, delta = value.real, q / value.real
        if best >= (1.0 - _ENOUGH) * upper[0]:
            break
    return best, delta


@dataclass(frozen=True, eq=False)
class _Basis:
    """Directions of log T and of G: Hermitian matrices, shapes (k, n, n)."""

    of_t: Complexes
    of_g: Complexes

    def scalings(self, point: Arrays) -> tuple[Complexes, Complexes]:
        """T = expm(X / 2) and G."""
        count, n = len(self.of_t), self.of_t.shape[1]
        values, vectors = np.linalg.eigh(np.tensordot(point[:count], self.of_t, axes=1).reshape(n, n))
        t = (vectors * np.exp(0.5 * values)) @ vectors.conj().T
        return t, np.tensordot(point[count:], self.of_g, axes=1).reshape(n, n)


def _basis(blocks: Blocks) -> _Basis:
    """A common factor of T changes nothing, so the first direction is left out."""
    n = sum(blocks.sizes)
    of_t, of_g = [], []
    for part, real in blocks.parts:
        if not real:
            of_t.append(_at(n, part, np.eye(part.stop - part.start)))
            continue
        hermitian = [_at(n, part, one) for one in _hermitians(part.stop - part.start)]
        of_t += hermitian
        of_g += hermitian
    empty = np.zeros((0, n, n), dtype=np.complex128)
    return _Basis(np.array(of_t[1:]) if len(of_t) > 1 else empty, np.array(of_g) if of_g else empty)


def _hermitians(size: int) -> list[Complexes]:
    basis = []
    for row in range(size):
        for column in range(row, size):
            one = np.zeros((size, size), dtype=np.complex128)
            one[row, column] = one[column, row] = 1.0
            basis.append(one)
            if column > row:
                turned = np.zeros((size, size), dtype=np.complex128)
                turned[row, column], turned[column, row] = 1j, -1j
                basis.append(turned)
    return basis


def _at(n: int, part: slice, block: Complexes | Arrays) -> Complexes:
    padded = np.zeros((n, n), dtype=np.complex128)
    padded[part, part] = block
    return padded


def _hermitian(matrix: Complexes, t: Complexes, g: Complexes) -> tuple[Complexes, Complexes]:
    scaled = t @ matrix @ np.linalg.inv(t)
    turned = 1j * g @ scaled
    return scaled, scaled.conj().T @ scaled + turned + turned.conj().T


def _bound(matrix: Complexes, t: Complexes, g: Complexes) -> float:
    return float(np.sqrt(max(float(np.linalg.eigvalsh(_hermitian(matrix, t, g)[1])[-1]), 0.0)))


def _smooth(point: Arrays, matrix: Complexes, basis: _Basis, sharp: float) -> tuple[float, Arrays]:
    """A smooth bound of the largest eigenvalue from above, and its gradient."""
    count = len(basis.of_t)
    t, g = basis.scalings(point)
    scaled, hermitian = _hermitian(matrix, t, g)
    values, vectors = np.linalg.eigh(hermitian)
    share = np.exp(sharp * (values - values[-1]))
    total = share.sum()
    weight = (vectors * (share / total)) @ vectors.conj().T
    inner = weight @ (scaled.conj().T + 1j * g)
    by_t = np.linalg.inv(t) @ (scaled @ inner - inner @ scaled)  # d value = 2 Re tr(by_t dT)
    changes = _root_changes(np.tensordot(point[:count], basis.of_t, axes=1), basis.of_t)
    slope_t = 2.0 * np.einsum("ij,kji->k", by_t, changes).real
    slope_g = 2.0 * np.einsum("ij,kji->k", 1j * scaled @ weight, basis.of_g).real
    return float(values[-1] + np.log(total) / sharp), np.concatenate([slope_t, slope_g])


def _root_changes(x: Complexes, directions: Complexes) -> Complexes:
    """Change of expm(X / 2) along directions, by the divided differences of its eigenvalues."""
    values, vectors = np.linalg.eigh(x)
    high, low = np.maximum.outer(values, values), np.minimum.outer(values, values)
    apart = 0.5 * (high - low)
    # exp(high / 2) - exp(low / 2) over high - low
    quotient = 0.5 * np.exp(0.5 * low) * np.where(apart < 1e-8, 1.0 + 0.5 * apart, np.expm1(apart) / (apart + 1e-300))
    inner = vectors.conj().T @ directions @ vectors
    return np.asarray(vectors @ (quotient * inner) @ vectors.conj().T)


def _dual_starts(
    matrix: Complexes, blocks: Blocks, upper: tuple[float, Complexes, Complexes], random: np.random.Generator
) -> list[Arrays]:
    """Perturbations by the eigenvectors v of the upper bound: with y = M~ v, v = Delta y where both bounds meet."""
    bound, t, g = upper
    scaled, hermitian = _hermitian(matrix, t, g)
    values, vectors = np.linalg.eigh(hermitian)
    starts = []
    for share in _NEAR:
        space = vectors[:, values >= values[-1] - share * abs(values[-1])]
        v = space @ (random.normal(size=(space.shape[1], 2)) @ np.array([1.0, 1j]))
        v, y = np.linalg.solve(t, v), np.linalg.solve(t, scaled @ v)
        unknown: list[Arrays] = []
        for part, real in blocks.parts:
            size = float(np.linalg.norm(y[part])) ** 2 + np.finfo(float).tiny
            if real:
                unknown.append(np.clip([bound * float((y[part].conj() @ v[part]).real) / size], -1.0, 1.0))
            else:
                unknown += [np.asarray(one) for z in (v[part], y[part]) for one in (z.real, z.imag)]
        starts.append(np.concatenate(unknown))
    return starts


def _random_start(blocks: Blocks, random: np.random.Generator) -> Arrays:
    return np.concatenate([
        random.choice([-1.0, 1.0], 1) if real else random.normal(size=4 * (part.stop - part.start))
        for part, real in blocks.parts
    ])  # fmt: skip


def _perturbation(blocks: Blocks, unknown: Arrays) -> Complexes:
    """Q of real numbers and of dyads of unit length."""
    n, place = sum(blocks.sizes), 0
    q = np.zeros((n, n), dtype=np.complex128)
    for part, real in blocks.parts:
        size = part.stop - part.start
        if real:
            q[part, part] = unknown[place] * np.eye(size)
        else:
            x, y = _dyad(unknown[place : place + 4 * size])
            q[part, part] = np.outer(x, y.conj())
        place += 1 if real else 4 * size
    return q


def _dyad(values: Arrays) -> tuple[Complexes, Complexes]:
    a, b, c, d = np.split(values, 4)
    tiny = np.finfo(float).tiny
    x, y = (np.asarray(z / (np.linalg.norm(z) + tiny), dtype=np.complex128) for z in (a + 1j * b, c + 1j * d))
    return x, y


@dataclass(eq=False)
class _Eigenvalue:
    """One eigenvalue of M Q and its gradient, followed from call to call."""

    matrix: Complexes
    blocks: Blocks
    followed: complex | None = None
    kept: tuple[Arrays, complex, Complexes] | None = None

    def part(self, unknown: Arrays, sign: float) -> tuple[float, Arrays]:
        """The real part times a sign, and its gradient."""
        value, slope = self.at(unknown)
        return sign * value.real, sign * slope.real

    def at(self, unknown: Arrays) -> tuple[complex, Complexes]:
        """The eigenvalue and its gradient."""
        if self.kept is not None and np.array_equal(self.kept[0], unknown):
            return self.kept[1], self.kept[2]
        q = _perturbation(self.blocks, unknown)
        values, right = np.linalg.eig(self.matrix @ q)
        place = int(np.argmax(values.real if self.followed is None else -np.abs(values - self.followed)))
        left = np.linalg.pinv(right)[place]
        by_q = np.outer(right[:, place], left @ self.matrix)  # d value = tr(by_q dQ)
        self.followed = complex(values[place])
        self.kept = unknown.copy(), self.followed, self._slope(unknown, by_q)
        return self.kept[1], self.kept[2]

    def _slope(self, unknown: Arrays, by_q: Complexes) -> Complexes:
        slopes, place = [], 0
        for part, real in self.blocks.parts:
            size = part.stop - part.start
            if real:
                slopes.append(np.array([np.trace(by_q[part, part])]))
                place += 1
                continue
            values = unknown[place : place + 4 * size]
            a, b, c, d = np.split(values, 4)
            (x, y), block = _dyad(values), by_q[part, part]
            lengths = np.linalg.norm(a + 1j * b), np.linalg.norm(c + 1j * d)
            by_x, by_y = (y.conj() @ block) / lengths[0], (block @ x) / lengths[1]
            value = y.conj() @ block @ x
            slopes += [
                by_x - value * x.real / lengths[0],
                1j * by_x - value * x.imag / lengths[0],
                by_y - value * y.real / lengths[1],
                -1j * by_y - value * y.imag / lengths[1],
            ]
            place += 4 * size
        return np.concatenate(slopes)
