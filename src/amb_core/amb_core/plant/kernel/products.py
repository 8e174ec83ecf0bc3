"""Small products of matrix and vector in compiled code, in strict order of summation."""

from __future__ import annotations

import numba


@numba.njit(inline="always", error_model="numpy")
def add_product(columns, vector, result):
    """Add a matrix-vector product, the matrix by columns; four running sums at a time become one vector register."""
    for first in range(0, columns.shape[1], 4):
        a, b, c, d = result[first], result[first + 1], result[first + 2], result[first + 3]
        for n in range(columns.shape[0]):
            factor = vector[n]
            a += columns[n, first] * factor
            b += columns[n, first + 1] * factor
            c += columns[n, first + 2] * factor
            d += columns[n, first + 3] * factor
        result[first], result[first + 1], result[first + 2], result[first + 3] = a, b, c, d
