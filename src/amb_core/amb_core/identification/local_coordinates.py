"""Data-driven local coordinates: the directions in which a state-space model changes, and not only its coordinates.

A model (A, B, C) with n states, m inputs and p outputs has n (n + m + p) matrix entries, but n^2 of their directions
are changes of the state's coordinates, T A T^-1, T B, C T^-1, to first order

    X A - A X,  X B,  -C X.

The n (m + p) directions orthogonal to these are coordinates of the models near by.

Source: T. McKelvey, A. Helmersson and T. Ribarits, Data driven local coordinates for multivariable linear systems and
their application to system identification, Automatica 40 (2004).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Arrays = NDArray[np.float64]


def local_directions(a: Arrays, b: Arrays, c: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    """Orthonormal directions of change of A, B and C, shapes (n, n, q), (n, m, q), (p, n, q) with q = n (m + p).

    In innovations form K changes as B does, so b may be (B, K).
    """
    n, m, p = len(a), b.shape[1], len(c)
    unit = np.eye(n)
    # Entry (row, column) of X along the last axis.
    by_a = np.einsum("ir,cj->ijrc", unit, a) - np.einsum("ir,cj->ijrc", a, unit)
    by_b = np.einsum("ir,cj->ijrc", unit, b)
    by_c = -np.einsum("ir,cj->ijrc", c, unit)
    changes = np.vstack([change.reshape(-1, n * n) for change in (by_a, by_b, by_c)])
    others = np.linalg.qr(changes, mode="complete")[0][:, n * n :]
    of_a, of_b, of_c = np.split(others, [n * n, n * (n + m)])
    return of_a.reshape(n, n, -1), of_b.reshape(n, m, -1), of_c.reshape(p, n, -1)
