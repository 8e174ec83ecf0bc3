"""Products of small matrices inside compiled loops.

They are written as loops: at this size `@` spends its time calling BLAS, and it takes seconds to compile.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True)
def set_product(matrix: NDArray[np.float64], vector: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """Put matrix @ vector into `result`; shapes (n, m), (m,), (n,)."""
    for row in range(matrix.shape[0]):
        result[row] = 0.0
    add_product(matrix, vector, result)


@numba.njit(cache=True)
def add_product(matrix: NDArray[np.float64], vector: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """Add matrix @ vector to `result`; shapes (n, m), (m,), (n,)."""
    for row in range(matrix.shape[0]):
        total = result[row]
        for column in range(matrix.shape[1]):
            total += matrix[row, column] * vector[column]
        result[row] = total


@numba.njit(cache=True)
def set_matrix_product(left: NDArray[np.float64], right: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """Put left @ right into `result`; shapes (n, m), (m, q), (n, q)."""
    for row in range(left.shape[0]):
        for column in range(right.shape[1]):
            result[row, column] = 0.0
        for inner in range(left.shape[1]):
            factor = left[row, inner]
            for column in range(right.shape[1]):
                result[row, column] += factor * right[inner, column]
