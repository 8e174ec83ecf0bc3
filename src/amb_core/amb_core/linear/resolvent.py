"""The only place that solves with z I - A: the frequency response of state-space matrices, and its parts.

With the resolvent R(z) = (z I - A)^-1 the response is C R B + D. Points z are taken in parts, so that a fine grid of a
large system does not fill the memory.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Arrays = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_ENTRIES_AT_ONCE = 100_000  # of the matrices z I - A held at once


def parts_of(points: Complexes, order: int) -> Iterator[slice]:
    """Which points are taken together."""
    at_once = max(1, _ENTRIES_AT_ONCE // max(order, 1) ** 2)
    for start in range(0, len(points), at_once):
        yield slice(start, min(start + at_once, len(points)))


def states_by_input(a: Arrays, b: Arrays, points: Complexes) -> Complexes:
    """R b, shape (points, n, m); LinAlgError where a pole lies at one of the points."""
    return np.asarray(np.linalg.solve(_shifted(a, points), b.astype(np.complex128)[np.newaxis]))


def outputs_by_state(a: Arrays, c: Arrays, points: Complexes) -> Complexes:
    """C R, shape (points, p, n); LinAlgError where a pole lies at one of the points."""
    transposed = np.linalg.solve(_shifted(a, points).transpose(0, 2, 1), c.T.astype(np.complex128)[np.newaxis])
    return np.asarray(transposed.transpose(0, 2, 1))


def response(a: Arrays, b: Arrays, c: Arrays, d: Arrays, points: Complexes) -> Complexes:
    """C R B + D, shape (points, p, m); infinite where a pole lies at a point."""
    values = np.empty((len(points), *d.shape), dtype=np.complex128)
    if not len(a):
        values[:] = d
        return values
    for part in parts_of(points, len(a)):
        try:
            values[part] = c @ states_by_input(a, b, points[part]) + d
        except np.linalg.LinAlgError:  # at one of the points; the others one by one
            if len(points) == 1:
                values[:] = np.inf
                return values
            for place in range(part.start, part.stop):
                values[place] = response(a, b, c, d, points[place : place + 1])[0]
    return values


def response_and_slope(a: Arrays, b: Arrays, c: Arrays, d: Arrays, points: Complexes) -> tuple[Complexes, Complexes]:
    """C R B + D and its derivative by z, -C R R B; LinAlgError where a pole lies at one of the points."""
    shifted = _shifted(a, points)
    states = states_by_input(a, b, points)
    return np.asarray(c @ states + d), np.asarray(-c @ np.linalg.solve(shifted, states))


def _shifted(a: Arrays, points: Complexes) -> Complexes:
    return np.asarray(points[:, np.newaxis, np.newaxis] * np.eye(len(a)) - a)
