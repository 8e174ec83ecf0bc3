"""Upper bound of the structured singular value of scalar uncertainties, by D and G scalings.

For any real x and g (g_i = 0 where perturbation i is complex), with M~ = diag(e^(x/2)) M diag(e^(-x/2)),

    mu(M)^2 <= max(0, lambda_max(M~' M~ + j (G M~ - M~' G))).

So every evaluation is a valid bound, whether or not the search for the best scalings has converged. Where all
perturbations are complex the scalings are SLICOT's AB13MD. Where some are real they are found here: AB13MD (as in
ctrlsys 1.1.1) does not return for some matrices with real blocks, even of size 2.

Source: M. K. H. Fan, A. L. Tits and J. C. Doyle, Robustness in the presence of mixed parametric uncertainty and
unmodeled dynamics, IEEE Transactions on Automatic Control 36 (1991).
"""

from __future__ import annotations

import ctrlsys
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from amb_core.robustness.lti import Arrays, Complexes

SHARPNESS = (20.0, 200.0, 2_000.0)
"""Of the smooth stand-in for the largest eigenvalue, one after the other; relative to it."""
_FINE = 60  # steps of each search
_COARSE = 12
_NEARLY = 0.98  # of the largest bound: lower values of a curve are left coarse


def upper_bound(matrix: Complexes, real: NDArray[np.bool_]) -> float:
    """Upper bound of mu of a matrix.

    Parameters
    ----------
    matrix : ndarray of complex, shape (n, n)
        M.
    real : ndarray of bool, shape (n,)
        Which perturbations are real.
    """
    balanced = balance(matrix)
    largest = float(np.linalg.norm(balanced, 2))
    if len(matrix) == 1 or largest == 0.0:
        return _scalar(complex(matrix[0, 0]), bool(real[0])) if len(matrix) == 1 else 0.0
    if np.any(real):
        return largest * _mixed(balanced / largest, real, np.zeros(2 * len(matrix)), SHARPNESS, _FINE)[0]
    kinds = np.full(len(matrix), 2, dtype=np.int32)
    bound, *_, info = ctrlsys.ab13md(np.asfortranarray(balanced / largest), np.ones(len(matrix), np.int32), kinds, "N")
    return min(largest, float(bound) * largest) if info == 0 else largest


def upper_curve(matrices: Complexes, real: NDArray[np.bool_]) -> Arrays:
    """Upper bounds for the matrices of neighbouring frequencies, shape (f,): scalings start from the neighbour's.

    Where all perturbations are complex, only values that may be the largest are found by AB13MD; the others keep the
    bound of balanced scalings.
    """
    if not np.any(real) or matrices.shape[1] == 1:
        return _complex_curve(matrices, real)
    bounds, start = np.empty(len(matrices)), np.zeros(2 * matrices.shape[1])
    for place, matrix in enumerate(matrices):
        balanced = balance(matrix)
        largest = float(np.linalg.norm(balanced, 2))
        if largest == 0.0:
            bounds[place] = 0.0
            continue
        bounds[place], start = _mixed(balanced / largest, real, start, SHARPNESS[1:2], _COARSE)
        bounds[place] *= largest
    return bounds


def _complex_curve(matrices: Complexes, real: NDArray[np.bool_]) -> Arrays:
    if matrices.shape[1] == 1:
        return np.array([upper_bound(matrix, real) for matrix in matrices])
    bounds = np.linalg.norm(np.array([balance(matrix) for matrix in matrices]), 2, axis=(1, 2))
    largest = 0.0
    for place in np.argsort(-bounds):
        if bounds[place] < _NEARLY * largest:
            break
        bounds[place] = upper_bound(matrices[place], real)
        largest = max(largest, bounds[place])
    return bounds


def balance(matrix: Complexes) -> Complexes:
    """D M D^-1 with rows and columns of equal norm; a perturbation of diagonal form does not see D."""
    scale = balancing(matrix)
    return np.asarray(matrix * scale[:, np.newaxis] / scale)


def balancing(matrix: Complexes, sweeps: int = 6) -> Arrays:
    """The diagonal of D for which D M D^-1 has rows and columns of equal norm (Osborne), shape (n,)."""
    size = np.abs(matrix) ** 2
    np.fill_diagonal(size, 0.0)
    size += 1e-24 * float(size.max(initial=0.0)) + np.finfo(float).tiny
    squared = np.ones(len(matrix))
    for _ in range(sweeps):
        for place in range(len(matrix)):
            row, column = size[place].sum(), size[:, place].sum()
            ratio = np.sqrt(column / row)
            size[place] *= ratio
            size[:, place] /= ratio
            squared[place] *= ratio
    return np.asarray(np.sqrt(squared))


def _scalar(value: complex, real: bool) -> float:
    if not real:
        return abs(value)
    return abs(value.real) if abs(value.imag) <= 1e-12 * abs(value) else 0.0


def _mixed(
    matrix: Complexes, real: NDArray[np.bool_], start: Arrays, sharpness: tuple[float, ...], steps: int
) -> tuple[float, Arrays]:
    """The least bound found for a matrix of norm 1 from a start of (x, g), and its scalings."""
    n = len(matrix)
    free = np.concatenate([np.ones(n, dtype=bool), real])
    free[0] = False  # a common factor of D changes nothing
    best, at = _bound(matrix, start), start
    for sharp in sharpness:
        begin = at if best < 1.0 else np.zeros(2 * n)

        def cost(point: Arrays, sharp: float = sharp) -> tuple[float, Arrays]:
            whole = np.zeros(2 * n)
            whole[free] = point
            value, slope = _smooth(matrix, whole, sharp)
            return value, slope[free]

        found = minimize(cost, begin[free], jac=True, method="L-BFGS-B", options={"maxiter": steps})
        trial = np.zeros(2 * n)
        trial[free] = found.x
        value = _bound(matrix, trial)
        if value < best:
            best, at = value, trial
    return min(best, 1.0), at


def _hermitian(matrix: Complexes, point: Arrays) -> tuple[Complexes, Complexes]:
    n = len(matrix)
    half = np.exp(0.5 * np.clip(point[:n], -60.0, 60.0))
    scaled = matrix * half[:, np.newaxis] / half
    turned = 1j * point[n:, np.newaxis] * scaled
    return scaled, scaled.conj().T @ scaled + turned + turned.conj().T


def _bound(matrix: Complexes, point: Arrays) -> float:
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(_hermitian(matrix, point)[1])[-1])))


def _smooth(matrix: Complexes, point: Arrays, sharp: float) -> tuple[float, Arrays]:
    """A smooth bound of the largest eigenvalue from above, and its gradient."""
    n = len(matrix)
    scaled, hermitian = _hermitian(matrix, point)
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
