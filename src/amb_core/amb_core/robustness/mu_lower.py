"""Lower bound of mu: a perturbation that makes a loop singular at a frequency.

With Q = diag(q), |q_i| <= 1, real where the perturbation is real, an eigenvalue of M Q that is real and positive, of
value lambda, is a lower bound, and Q/lambda the perturbation. The largest one is sought:

- Where all perturbations are complex, by the power iteration for alignment, from several starts. A common phase then
  makes the eigenvalue real.
- Where some are real, by sequential quadratic programming from several starts: the largest Re lambda with Im lambda = 0
  over real q in [-1, 1], phases of complex q, and, where all perturbations are real, the frequency. A simple eigenvalue
  has the gradient d lambda = w' M dQ v for its left and right eigenvectors with w' v = 1. Newton's method in a common
  phase of the complex q, or in the frequency, then brings the imaginary part to rounding.

The power iteration of Young and Doyle for real perturbations often does not converge where a real perturbation lies
inside its range at the optimum; the programming does.

Sources: A. Packard and J. C. Doyle, The complex structured singular value, Automatica 29 (1993); P. M. Young and J. C.
Doyle, Computation of mu with real and complex uncertainties, Conference on Decision and Control (1990).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import zgeev
from scipy.optimize import minimize

from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.robustness.mu_upper import balancing, hermitian_of

_STARTS = 12  # of the power iteration
_PROGRAMS = 32  # random starts of the programming, of which many end at local optima
_TOPS = (1e-6, 1e-3, 0.05)  # eigenvalues of the upper bound whose eigenvectors start the programming, from the largest
_COMBINATIONS = 3  # of several eigenvectors
_STEPS = 60  # of each search
_SPAN = 0.3  # of the frequency, either way, within which real perturbations may find another
_NEWTON = 8
_MULTIPLE = 1e-13  # product of left and right eigenvector at most, of an eigenvalue that is taken as multiple
_REAL = 1e-9  # imaginary part at most, relative, of an eigenvalue that is taken as real
_ENOUGH = 1e-4  # a lower bound so close to the upper one ends the search over real perturbations, relative

LowerBound = tuple[float, float, Complexes]


def lower_bound(
    system: LinearSystem,
    real: NDArray[np.bool_],
    frequency: float,
    upper: float = np.inf,
    seed: int = 0,
    scaling: Arrays | None = None,
    programs: int = _PROGRAMS,
) -> LowerBound:
    """Lower bound of mu near a frequency.

    Parameters
    ----------
    system : LinearSystem
        M.
    real : ndarray of bool, shape (n,)
        Which perturbations are real.
    frequency : float
        Frequency (Hz).
    upper : float
        Known upper bound, at which the search may end.
    seed : int
        Of the starts.
    scaling : ndarray, shape (2 n,), optional
        Scalings (x, g) of the upper bound there. Where both bounds meet, its eigenvectors hold the perturbation, so the
        search starts from them. It needs this for a lightly damped mode that the loop hardly sees: few of all
        perturbations move its pole to the frequency.
    programs : int
        Random starts besides.

    Returns
    -------
    tuple
        The bound, its frequency (Hz), and the perturbation, shape (n,); 0 and an empty one if none was found.
    """
    matrix = system.response(np.array([frequency]))[0]
    scale = balancing(matrix)
    size = float(np.linalg.norm(matrix * scale[:, np.newaxis] / scale, 2))
    if size == 0.0:
        return 0.0, frequency, np.zeros(0, dtype=np.complex128)
    # The same eigenvalues, near 1: D M D^-1 over its norm.
    scaled = system.scaled(scale / size, 1.0 / scale)
    random = np.random.default_rng(seed)
    if not np.any(real):
        largest = _aligned(scaled, frequency, random)
    else:
        starts = [] if scaling is None else _dual_starts(matrix, real, scaling, random)
        largest = _programmed(scaled, real, frequency, upper / size * (1.0 - _ENOUGH), random, starts, programs)
    value, at, q = largest
    if value <= 0.0:
        return 0.0, frequency, np.zeros(0, dtype=np.complex128)
    return value * size, at, q / (value * size)


def _aligned(system: LinearSystem, frequency: float, random: np.random.Generator) -> LowerBound:
    """The largest eigenvalue of M Q found with |q_i| = 1, and Q turned so that it is real; all starts at once."""
    matrix = system.response(np.array([frequency]))[0]
    n, tiny = len(matrix), np.finfo(float).tiny
    b, w = (random.normal(size=(_STARTS, n, 2)) @ np.array([1.0, 1j]) for _ in range(2))
    q = np.ones((_STARTS, n), dtype=np.complex128)
    for _ in range(_STEPS):
        a = _unit(b @ matrix.T)
        w = _unit(np.abs(w) * a / (np.abs(a) + tiny) @ matrix.conj())
        phase = w * a.conj()
        q = phase / (np.abs(phase) + tiny)
        b = _unit(q * a)
    values = np.linalg.eigvals(matrix * q[:, np.newaxis, :])
    start, place = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
    best, phases = values[start, place], np.angle(q[start])
    eigenvalue = _Eigenvalue(system, np.zeros(n, dtype=bool), frequency, False, complex(best))
    if best != 0.0:  # the iteration can be slow; the gradient is not
        try:
            phases = minimize(eigenvalue.size, phases, jac=True, method="BFGS", options={"maxiter": _STEPS}).x
        except np.linalg.LinAlgError:
            eigenvalue.followed = complex(best)
        best = eigenvalue.at(phases)[0]
    return float(abs(best)), frequency, np.exp(1j * (phases - np.angle(best)))


def _unit(vectors: Complexes) -> Complexes:
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + np.finfo(float).tiny))


@dataclass(eq=False)
class _Eigenvalue:
    """One eigenvalue of M Q and its gradient, followed from call to call.

    The unknowns are the real q, the phases of the complex q, and the frequency (relative to the first) if `moving`.
    """

    system: LinearSystem
    real: NDArray[np.bool_]
    frequency: float
    moving: bool
    followed: complex | None = None
    kept: tuple[Arrays, complex, Complexes] | None = None
    matrix: Complexes = field(init=False)

    def __post_init__(self) -> None:
        self.matrix = self.system.response(np.array([self.frequency]))[0]

    def factors(self, unknown: Arrays) -> Complexes:
        """The diagonal of Q."""
        q = np.empty(len(self.real), dtype=np.complex128)
        count = int(self.real.sum())
        q[self.real] = unknown[:count]
        q[~self.real] = np.exp(1j * unknown[count : len(self.real)])
        return q

    def at(self, unknown: Arrays) -> tuple[complex, Complexes]:
        """The eigenvalue and its gradient."""
        if self.kept is not None and np.array_equal(self.kept[0], unknown):
            return self.kept[1], self.kept[2]
        matrix, change = self._response(unknown)
        q = self.factors(unknown)
        values, left_vectors, right, _ = zgeev(matrix * q)
        by = np.abs(values) if self.followed is None else -np.abs(values - self.followed)
        place = int(np.argmax(by))
        left = left_vectors[:, place].conj()
        product = left @ right[:, place]
        if abs(product) < _MULTIPLE:
            raise np.linalg.LinAlgError("a multiple eigenvalue has no derivative")
        left = left / product
        share = (left @ matrix) * right[:, place]  # d lambda / d q; the sum of share q = lambda
        slope = [share[self.real], (1j * q * share)[~self.real]]
        if change is not None:
            slope.append(np.array([left @ (change * q) @ right[:, place]]))
        self.followed = complex(values[place])
        self.kept = unknown.copy(), self.followed, np.concatenate(slope)
        return self.kept[1], self.kept[2]

    def size(self, unknown: Arrays) -> tuple[float, Arrays]:
        """The magnitude of lambda and its gradient, both negative."""
        value, slope = self.at(unknown)
        return -abs(value), np.asarray(-(slope * np.conj(value)).real / abs(value))

    def real_part(self, unknown: Arrays) -> tuple[float, Arrays]:
        """-Re lambda and its gradient."""
        value, slope = self.at(unknown)
        return -value.real, -slope.real

    def _response(self, unknown: Arrays) -> tuple[Complexes, Complexes | None]:
        """M, and its derivative by the relative frequency if that is unknown."""
        if not self.moving:
            return self.matrix, None
        system = self.system
        turn = 2.0 * np.pi * self.frequency * system.sample_time
        z = np.exp(1j * turn * unknown[-1])
        value, slope = system.slope_at(z)
        return value, 1j * turn * z * slope


def _dual_starts(
    matrix: Complexes, real: NDArray[np.bool_], scaling: Arrays, random: np.random.Generator
) -> list[Complexes]:
    """Diagonals of Q from the eigenvectors v of the upper bound: with y = M~ v, v = delta y where both bounds meet."""
    scaled, hermitian = hermitian_of(matrix, scaling)
    values, vectors = np.linalg.eigh(hermitian)
    bound = np.sqrt(max(float(values[-1]), 0.0))
    starts = []
    for share in _TOPS:
        space = vectors[:, values >= (1.0 - share) * values[-1]]
        for _ in range(1 if space.shape[1] == 1 else _COMBINATIONS):
            v = space @ (random.normal(size=(space.shape[1], 2)) @ np.array([1.0, 1j]))
            y = scaled @ v
            ratio = v * y.conj() / (np.abs(y) ** 2 + np.finfo(float).tiny)
            phase = ratio / (np.abs(ratio) + np.finfo(float).tiny)
            starts.append(np.where(real, np.clip(bound * ratio.real, -1.0, 1.0), phase))
    return starts


def _programmed(
    system: LinearSystem,
    real: NDArray[np.bool_],
    frequency: float,
    enough: float,
    random: np.random.Generator,
    starts: list[Complexes],
    programs: int,
) -> LowerBound:
    """The largest real eigenvalue of M Q over Q, and over frequencies about one if all perturbations are real."""
    count, n, half = int(real.sum()), len(real), 0.5 / system.sample_time
    at_end = frequency <= 0.0 or frequency >= half  # M is real: so are the eigenvalues of M Q that count
    moving = count == n and not at_end
    best: LowerBound = (0.0, frequency, np.zeros(0, dtype=np.complex128))
    limits: list[tuple[float | None, float | None]] = [(-1.0, 1.0)] * count
    limits += [(None, None)] * (n - count)
    if moving:
        limits.append((1.0 - _SPAN, min(1.0 + _SPAN, half / frequency)))
    for start in range(len(starts) + programs):
        eigenvalue = _Eigenvalue(system, real, frequency, moving)
        if start < len(starts):
            corner, phases = starts[start][real].real, np.angle(starts[start][~real])
        else:
            corner = random.choice([-1.0, 1.0], size=count) if start % 2 else random.uniform(-1.0, 1.0, count)
            phases = random.uniform(0.0, 2.0 * np.pi, n - count)
        unknown = np.concatenate([corner, phases, np.ones(int(moving))])
        try:
            solution = _solved(eigenvalue, unknown, limits, constrained=not (at_end and count == n))
        except np.linalg.LinAlgError:  # a multiple eigenvalue: another start
            continue
        if solution[0] > best[0]:
            best = solution
        if best[0] >= enough:
            break
    return best


def _solved(
    eigenvalue: _Eigenvalue, unknown: Arrays, limits: list[tuple[float | None, float | None]], constrained: bool
) -> LowerBound:
    """A local optimum, with an eigenvalue that is real to rounding; 0 if there is none."""
    count = int(eigenvalue.real.sum())
    phases = slice(count, len(eigenvalue.real))
    first = eigenvalue.at(unknown)[0]
    unknown[phases] -= np.angle(first)
    eigenvalue.followed = complex(abs(first)) if count < len(eigenvalue.real) else first

    search = minimize(
        eigenvalue.real_part,
        unknown,
        jac=True,
        method="SLSQP",
        bounds=limits,
        constraints={
            "type": "eq",
            "fun": lambda at: eigenvalue.at(at)[0].imag,
            "jac": lambda at: eigenvalue.at(at)[1].imag,
        }
        if constrained
        else (),
        options={"maxiter": _STEPS, "ftol": 1e-10},
    )
    at = search.x.copy()
    at[:count] = np.clip(at[:count], -1.0, 1.0)
    value, slope = eigenvalue.at(at)
    for _ in range(_NEWTON if constrained else 0):  # in the common phase, or in the frequency
        rate = float(slope[phases].imag.sum()) if count < len(eigenvalue.real) else float(slope[-1].imag)
        if rate == 0.0 or value.imag == 0.0:
            break
        step = np.clip(value.imag / rate, -0.1, 0.1)
        at[phases if count < len(eigenvalue.real) else -1] -= step
        value, slope = eigenvalue.at(at)
    if not value.real > 0.0 or abs(value.imag) > _REAL * value.real:
        return 0.0, eigenvalue.frequency, np.zeros(0, dtype=np.complex128)
    frequency = eigenvalue.frequency * (float(at[-1]) if eigenvalue.moving else 1.0)
    return value.real, frequency, eigenvalue.factors(at)
