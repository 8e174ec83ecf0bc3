"""Small systems of equations in compiled code, solved in place in strict order of operations.

`system` is a square array whose first `size` rows and columns count, `unknown` the right-hand side that becomes the
solution. Made for fewer than a dozen unknowns, where a call of LAPACK takes longer than the work.
"""

from __future__ import annotations

import math

import numba


@numba.njit(inline="always", error_model="numpy")
def solve_positive(system, unknown, size):
    """Cholesky factorisation of a symmetric positive definite system, of which the lower triangle is given."""
    for a in range(size):
        for b in range(a + 1):
            total = system[a, b]
            for n in range(b):
                total -= system[a, n] * system[b, n]
            system[a, b] = math.sqrt(total) if a == b else total / system[b, b]
    for a in range(size):
        total = unknown[a]
        for n in range(a):
            total -= system[a, n] * unknown[n]
        unknown[a] = total / system[a, a]
    for back in range(size):
        a = size - 1 - back
        total = unknown[a]
        for n in range(a + 1, size):
            total -= system[n, a] * unknown[n]
        unknown[a] = total / system[a, a]


@numba.njit(inline="always", error_model="numpy")
def solve_general(system, unknown, size):
    """Gauss elimination, pivots by column."""
    for column in range(size):
        pivot = column
        for row in range(column + 1, size):
            if abs(system[row, column]) > abs(system[pivot, column]):
                pivot = row
        if pivot != column:
            for n in range(column, size):
                system[column, n], system[pivot, n] = system[pivot, n], system[column, n]
            unknown[column], unknown[pivot] = unknown[pivot], unknown[column]
        for row in range(column + 1, size):
            factor = system[row, column] / system[column, column]
            for n in range(column + 1, size):
                system[row, n] -= factor * system[column, n]
            unknown[row] -= factor * unknown[column]
    for back in range(size):
        row = size - 1 - back
        total = unknown[row]
        for n in range(row + 1, size):
            total -= system[row, n] * unknown[n]
        unknown[row] = total / system[row, row]
