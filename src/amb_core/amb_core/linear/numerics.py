"""Numerics that the methods share: small matrices, singular values, problems without a solution, limit of stability."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from threadpoolctl import ThreadpoolController

from amb_core.ground.errors import IdentificationError

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
