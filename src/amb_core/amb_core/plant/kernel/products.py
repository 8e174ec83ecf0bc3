"""Small products of matrix and vector in compiled code, in strict order of summation."""

from __future__ import annotations

import numba


@numba.njit(inline="always", error_model="numpy")
def accumulate(matrices, row, rows, column, vector, start, result, target):
    """Add four components of a matrix-vector product; four running sums become one vector register."""
    a, b, c, d = result[target], result[target + 1], result[target + 2], result[target + 3]
    for n in range(rows):
        factor = vector[start + n]
        a += matrices[row + n, column] * factor
        b += matrices[row + n, column + 1] * factor
        c += matrices[row + n, column + 2] * factor
        d += matrices[row + n, column + 3] * factor
    result[target], result[target + 1], result[target + 2], result[target + 3] = a, b, c, d
