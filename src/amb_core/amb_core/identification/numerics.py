"""Numerics that the methods share: small matrices, problems without a solution, the limit of stability."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from scipy import linalg
from threadpoolctl import threadpool_limits

from amb_core.errors import IdentificationError

LARGEST_RADIUS = 1.0 - 1e-6
"""Of the modes of a predictor or a closed loop that is taken as stable."""


@contextmanager
def small_matrices(failure: str) -> Iterator[None]:
    """Compute with one BLAS thread: more threads cost time, and take cores from the control loop.

    Raises
    ------
    IdentificationError
        With `failure` and the reason in one line, if linear algebra has no solution.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            yield
        except (linalg.LinAlgError, ValueError) as problem:
            raise IdentificationError(f"{failure}: {' '.join(str(problem).split())}") from None
