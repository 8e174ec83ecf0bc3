"""Numerics that the methods share: small matrices, triangular factors, singular values, limit of stability."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import ThreadpoolController

from amb_core.ground.errors import IdentificationError

_PANELS = ((250, 12), (500, 24), (math.inf, 48))  # columns up to which LAPACK is fastest, turning so many at once

LARGEST_RADIUS = 1.0 - 1e-6
"""Of the modes of a predictor or a closed loop that is taken as stable."""


@functools.cache
def _blas() -> ThreadpoolController:
    """The BLAS of numpy and scipy, which are imported by now; to find their libraries takes ten milliseconds."""
    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[object]:
    """Compute with one BLAS thread: more threads cost time on small matrices, and take cores from the control loop."""
    return _blas().limit(limits=1, user_api="blas")


@contextmanager
def small_matrices(failure: str) -> Iterator[None]:
    """Compute with one BLAS thread, and report where linear algebra fails.

    Raises
    ------
    IdentificationError
        With `failure` and the reason in one line, if linear algebra has no solution.
    """
    with one_blas_thread():
        try:
            yield
        except (linalg.LinAlgError, ValueError) as problem:
            raise IdentificationError(f"{failure}: {' '.join(str(problem).split())}") from None


def with_rows(triangle: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Triangular factor R of a triangle with more rows below it, whose R^T R is the sum of theirs.

    LAPACK's QR of a triangle on top of a matrix (tpqrt) leaves the zeros of the triangle out, and works in narrow
    panels: it takes a third of the time of the QR of both as one matrix, with the same reflections.

    Parameters
    ----------
    triangle : ndarray, shape (r, n)
        A triangular factor, with fewer than n rows where so few were given before.
    rows : ndarray, shape (m, n)
        The rows to add; unchanged.

    Returns
    -------
    ndarray, shape (min(r + m, n), n)
        The factor of both.
    """
    columns = rows.shape[1]
    if len(triangle) < columns:
        return np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"))
    if not rows.size:
        return triangle
    panel = next(panel for most, panel in _PANELS if columns <= most)
    return np.asarray(linalg.lapack.dtpqrt(0, min(panel, columns), triangle, rows)[0])


def thin_svd(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Singular value decomposition with as many vectors as values.

    LAPACK's fast method (gesdd) does not converge for rare matrices whose singular values span all orders of magnitude.
    The slower one (gesvd) does.

    Raises
    ------
    LinAlgError
        If neither converges.
    """
    try:
        left, singular, right = linalg.svd(matrix, full_matrices=False, check_finite=False)
    except linalg.LinAlgError:
        if not np.isfinite(matrix).all():
            raise
        left, singular, right = linalg.svd(matrix, full_matrices=False, lapack_driver="gesvd")
    return left, singular, right
