"""Directions in which a model changes, and their effect on its frequency response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Directions:
    """Directions in which a model changes.

    Attributes
    ----------
    a, b, c, k : ndarray, shapes (q, n, n), (q, n, m), (q, p, n), (q, n, p)
        Changes of A, B, C and K along each.
    d : ndarray, shape (q, p, m), or None
        Changes of D; None for models without direct feedthrough.
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    k: NDArray[np.float64]
    d: NDArray[np.float64] | None = None

    @property
    def count(self) -> int:
        """Number of directions q."""
        return len(self.a)

    @property
    def rows(self) -> NDArray[np.float64]:
        """Each direction as a row: the entries of A, B, C, K and, with feedthrough, D, row by row."""
        changes = (self.a, self.b, self.c, self.k) if self.d is None else (self.a, self.b, self.c, self.k, self.d)
        return np.hstack([change.reshape(self.count, -1) for change in changes])


def response_changes(
    by_state: NDArray[np.complex128],
    by_input: NDArray[np.complex128],
    of_a: NDArray[np.float64],
    of_b: NDArray[np.float64],
    of_c: NDArray[np.float64],
    of_d: NDArray[np.float64] | None = None,
) -> NDArray[np.complex128]:
    """Change of C R B + D, R = (z I - A)^-1, along each of q directions: C R dA R B + C R dB + dC R B + dD.

    Parameters
    ----------
    by_state, by_input : ndarray, shapes (f, p, n), (f, n, m)
        C R and R B.
    of_a, of_b, of_c, of_d : ndarray, shapes (q, n, n), (q, n, m), (q, p, n), (q, p, m)
        Changes of A, B, C and, if it changes, D.

    Returns
    -------
    ndarray, shape (f, p, m, q)
    """
    # As products of matrices, which einsum does not find: (C R dA + dC) R B, with axes in the order (f, p, q, ...).
    by_a = np.tensordot(by_state, of_a, axes=(2, 1)) + of_c.transpose(1, 0, 2)
    frequencies, p, q, n = by_a.shape
    changes = (by_a.reshape(frequencies, p * q, n) @ by_input).reshape(frequencies, p, q, -1)
    changes += np.tensordot(by_state, of_b, axes=(2, 1))
    if of_d is not None:
        changes += of_d.transpose(1, 0, 2)
    return np.asarray(changes.transpose(0, 1, 3, 2))
