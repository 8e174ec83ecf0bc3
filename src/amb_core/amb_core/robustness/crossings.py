"""Where the frequency response of a loop crosses the unit circle and the real axis, without a grid.

With L~(z) = L(1/z), |L| = 1 on the unit circle where L L~ = 1, and L is real where L - L~ = 0. Both are zeros of a
system of twice the order: generalised eigenvalues of a pencil, of which those of magnitude 1 count.

Source: T. Iwasaki and S. Hara, on zeros of para-Hermitian systems; N. A. Bruinsma and M. Steinbuch (1990), as in
`amb_core.linear.peak`.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigvals

from amb_core.linear import Arrays, LinearSystem

_ON_CIRCLE = 1e-5  # an eigenvalue so close to the unit circle is taken as a crossing, and confirmed by the response
_CONFIRMED = 1e-5  # of the response at a crossing


def gain_crossovers(loop: LinearSystem) -> Arrays:
    """Frequencies (Hz) at which a loop of one signal has the gain 1, ascending."""
    loop = loop.balanced()
    n, (a, b, c, d) = loop.order, (loop.a, loop.b, loop.c, loop.d)
    left = np.block(
        [[a, np.zeros((n, n)), b], [np.zeros((n, n)), np.eye(n), np.zeros((n, 1))], [d @ c, c, d @ d - 1.0]]
    )
    right = np.zeros_like(left)
    right[:n, :n] = np.eye(n)
    right[n : 2 * n] = np.hstack([b @ c, a, b @ d])
    return _confirmed(loop, left, right, lambda value: abs(abs(value) - 1.0))


def phase_crossovers(loop: LinearSystem) -> Arrays:
    """Frequencies (Hz) at which a loop of one signal is real, ascending, with 0 and half the sample rate."""
    loop = loop.balanced()
    n, (a, b, c) = loop.order, (loop.a, loop.b, loop.c)
    left = np.block(
        [[a, np.zeros((n, n)), b], [np.zeros((n, n)), np.eye(n), np.zeros((n, 1))], [c, -c, np.zeros((1, 1))]]
    )
    right = np.zeros_like(left)
    right[:n, :n] = np.eye(n)
    right[n : 2 * n] = np.hstack([np.zeros((n, n)), a, b])
    inner = _confirmed(loop, left, right, lambda value: abs(value.imag) / max(1.0, abs(value)))
    return np.unique(np.concatenate([[0.0], inner, [0.5 / loop.sample_time]]))


def _confirmed(loop: LinearSystem, left: Arrays, right: Arrays, error) -> Arrays:  # type: ignore[no-untyped-def]
    """Frequencies of the eigenvalues on the upper half of the unit circle at which the response is as it should be."""
    with np.errstate(divide="ignore", invalid="ignore"):
        z = eigvals(left, right)
    z = z[np.isfinite(z)]
    z = z[(np.abs(np.abs(z) - 1.0) < _ON_CIRCLE) & (z.imag >= 0.0)]
    frequency = np.sort(np.angle(z)) / (2.0 * np.pi * loop.sample_time)
    values = loop.response(frequency)[:, 0, 0]
    return np.array([at for at, value in zip(frequency, values, strict=True) if error(complex(value)) < _CONFIRMED])
