"""Upper bound of the structured singular value of scalar uncertainties, by D and G scalings.

For any real x and g (g_i = 0 where perturbation i is complex), with M~ = diag(e^(x/2)) M diag(e^(-x/2)),

    mu(M)^2 <= max(0, lambda_max(M~' M~ + j (G M~ - M~' G))).

So every evaluation is a valid bound, whether or not the search for the best scalings has converged, and the scalings of
one frequency give a valid bound at every other one. A curve uses this: scalings are searched at few frequencies and
where the bound may be the largest, and only evaluated at the others. SLICOT's AB13MD (as in ctrlsys 1.1.1) is not used:
it does not return for some matrices, with real perturbations even of size 2, with complex ones of size 3.

Source: M. K. H. Fan, A. L. Tits and J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
unmodeled dynamics, IEEE Transactions on Automatic Control 36 (1991).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from amb_core.linear import Arrays, Complexes

SHARPNESS = (20.0, 200.0, 2_000.0)
"""Of the smooth stand-in for the largest eigenvalue, one after the other; relative to it."""
_FINE = 60  # steps of each search
_COARSE = 12
_EVERY = 12  # frequencies of a curve from one search of scalings to the next
_CUTS = 8  # searches of scalings for one peak
_NEARLY = 0.98  # of the largest bound: lower values of a curve are left coarse
_STEEPEST = 120.0  # largest |x|


def upper_bound(matrix: Complexes, real: NDArray[np.bool_], start: Arrays | None = None) -> float:
    """Upper bound of mu of a matrix.

    Parameters
    ----------
    matrix : ndarray of complex, shape (n, n)
        M.
    real : ndarray of bool, shape (n,)
        Which perturbations are real.
    start : ndarray, shape (2 n,), optional
        Scalings (x, g) of a neighbouring matrix, from which the search starts.
    """
    if len(matrix) == 1:
        return _scalar(complex(matrix[0, 0]), bool(real[0]))
    return scalings(matrix, real, start)[0]


def upper_curve(matrices: Complexes, real: NDArray[np.bool_]) -> tuple[Arrays, Arrays]:
    """Upper bounds for the matrices of neighbouring frequencies, and their scalings.

    Values below 98 % of the largest are valid too, but not as small as they could be.

    Parameters
    ----------
    matrices : ndarray of complex, shape (f, n, n)
        M.
    real : ndarray of bool, shape (n,)
        Which perturbations are real.

    Returns
    -------
    tuple of ndarray, shapes (f,), (f, 2 n)
        Bounds and scalings (x, g).
    """
    count, n = matrices.shape[:2]
    points = np.hstack([2.0 * np.log(balancing(matrices)), np.zeros((count, n))])
    if n == 1:
        return np.array([upper_bound(matrix, real) for matrix in matrices]), points
    bounds = scaled_bounds(matrices, points)
    for place in range(0, count, _EVERY):
        start = points[place - _EVERY] if place else points[place]
        _spread(matrices, bounds, points, place, scalings(matrices[place], real, start, coarse=True)[1])
    fine = np.zeros(count, dtype=bool)
    while True:
        # The largest that is not fine yet; done once it is clearly below the largest of all.
        place = int(np.argmax(np.where(fine, -1.0, bounds)))
        if fine[place] or bounds[place] < _NEARLY * bounds.max() or bounds[place] == 0.0:
            return bounds, points
        fine[place] = True
        _spread(matrices, bounds, points, place, scalings(matrices[place], real, points[place])[1])


def top(matrices: Complexes, real: NDArray[np.bool_], frequency: Arrays, start: Arrays) -> tuple[float, float, Arrays]:
    """The largest bound over close frequencies, its frequency, and scalings there.

    The scalings are searched at the largest bound until that lowers it no more, and hold at all other frequencies.
    """
    bounds = scaled_bounds(matrices, start)
    for _ in range(_CUTS):
        place = int(np.argmax(bounds))
        before = bounds[place]
        start = scalings(matrices[place], real, start)[1]
        bounds = np.minimum(bounds, scaled_bounds(matrices, start))
        if bounds[place] >= before * (1.0 - 1e-4):
            break
    place = int(np.argmax(bounds))
    return float(bounds[place]), float(frequency[place]), start


def scaled_bounds(matrices: Complexes, points: Arrays) -> Arrays:
    """The bounds that given scalings make, shape (f,).

    Parameters
    ----------
    matrices : ndarray of complex, shape (f, n, n)
        M.
    points : ndarray, shape (f, 2 n) or (2 n,)
        Scalings (x, g); any are allowed.
    """
    points = np.broadcast_to(points, (len(matrices), 2 * matrices.shape[1]))
    hermitian = hermitian_of(matrices, points)[1]
    return np.sqrt(np.maximum(np.linalg.eigvalsh(hermitian)[:, -1], 0.0))


def scalings(
    matrix: Complexes, real: NDArray[np.bool_], start: Arrays | None = None, *, coarse: bool = False
) -> tuple[float, Arrays]:
    """The least bound found for a matrix, and its scalings (x, g).

    Parameters
    ----------
    matrix, real, start
        As for `upper_bound`.
    coarse : bool
        Whether a few steps are enough.
    """
    n = len(matrix)
    own = np.concatenate([2.0 * np.log(balancing(matrix)), np.zeros(n)])
    starts = np.array([own if start is None else start, own])
    bounds = scaled_bounds(np.array([matrix, matrix]), starts)
    at = starts[int(np.argmin(bounds))]
    largest = float(bounds.min())
    if largest == 0.0:
        return 0.0, at
    relative = np.concatenate([np.ones(n), np.full(n, largest)])  # g has the unit of M
    best, place = _searched(
        matrix / largest, real, at / relative, SHARPNESS[1:2] if coarse else SHARPNESS, _COARSE if coarse else _FINE
    )
    return best * largest, place * relative


def balancing(matrices: Complexes, sweeps: int = 6) -> Arrays:
    """The diagonals of D for which D M D^-1 has rows and columns of equal norm (Osborne), shapes (..., n, n), (..., n).

    A perturbation that nothing drives, or that drives nothing, has no such D; its D stays finite.
    """
    size = np.abs(matrices) ** 2
    n = size.shape[-1]
    size[..., np.arange(n), np.arange(n)] = 0.0
    size += 1e-24 * size.max(axis=(-2, -1), keepdims=True, initial=0.0) + np.finfo(float).tiny
    squared = np.ones(size.shape[:-1])
    for _ in range(sweeps):
        for place in range(n):
            ratio = np.sqrt(size[..., :, place].sum(axis=-1) / size[..., place, :].sum(axis=-1))
            size[..., place, :] *= ratio[..., np.newaxis]
            size[..., :, place] /= ratio[..., np.newaxis]
            squared[..., place] *= ratio
    return np.asarray(np.sqrt(squared))


def _spread(matrices: Complexes, bounds: Arrays, points: Arrays, place: int, point: Arrays) -> None:
    """Take scalings over to the frequencies around a place where they lower the bound."""
    near = slice(max(place - _EVERY, 0), place + _EVERY + 1)
    lower = scaled_bounds(matrices[near], point)
    better = lower < bounds[near]
    bounds[near] = np.where(better, lower, bounds[near])
    points[near] = np.where(better[:, np.newaxis], point, points[near])


def _scalar(value: complex, real: bool) -> float:
    if not real:
        return abs(value)
    return abs(value.real) if abs(value.imag) <= 1e-12 * abs(value) else 0.0


def _searched(
    matrix: Complexes, real: NDArray[np.bool_], start: Arrays, sharpness: tuple[float, ...], steps: int
) -> tuple[float, Arrays]:
    """The least bound found from scalings that give a matrix the bound 1, and its scalings."""
    n = len(matrix)
    free = np.concatenate([np.ones(n, dtype=bool), real])
    free[0] = False  # a common factor of D changes nothing
    best, at = 1.0, start
    if not np.any(free):
        return best, at

    def whole(point: Arrays) -> Arrays:
        scales = start.copy()
        scales[free] = point
        return scales

    def cost(point: Arrays, sharp: float) -> tuple[float, Arrays]:
        value, slope = _smooth(matrix, whole(point), sharp)
        return value, slope[free]

    for sharp in sharpness:
        search = minimize(cost, at[free], (sharp,), jac=True, method="L-BFGS-B", options={"maxiter": steps})
        trial = whole(search.x)
        value = float(scaled_bounds(matrix[np.newaxis], trial)[0])
        if value < best:
            best, at = value, trial
    return best, at


def hermitian_of(matrix: Complexes, point: Arrays) -> tuple[Complexes, Complexes]:
    """M~, and the matrix whose largest eigenvalue is the bound; shapes (..., n, n)."""
    n = matrix.shape[-1]
    half = np.exp(0.5 * np.clip(point[..., :n], -_STEEPEST, _STEEPEST))
    scaled = matrix * half[..., :, np.newaxis] / half[..., np.newaxis, :]
    turned = 1j * point[..., n:, np.newaxis] * scaled
    return scaled, scaled.conj().swapaxes(-1, -2) @ scaled + turned + turned.conj().swapaxes(-1, -2)


def _smooth(matrix: Complexes, point: Arrays, sharp: float) -> tuple[float, Arrays]:
    """A smooth bound of the largest eigenvalue from above, and its gradient."""
    n = len(matrix)
    scaled, hermitian = hermitian_of(matrix, point)
    values, v = np.linalg.eigh(hermitian)
    share = np.exp(sharp * (values - values[-1]))
    total = share.sum()
    share /= total
    y, u = scaled @ v, point[n:, np.newaxis] * v
    back = (y.conj().T @ scaled).T  # (y' M~)_i, a column for each eigenvector
    turned = (u.conj().T @ scaled).T
    by_x = np.abs(y) ** 2 - (back * v).real + (1j * (u.conj() * y - turned * v)).real
    by_g = -2.0 * (v.conj() * y).imag
    return float(values[-1] + np.log(total) / sharp), np.concatenate([by_x @ share, by_g @ share])
