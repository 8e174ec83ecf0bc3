"""The poles that the rigid rotor has in the closed loop, among those of amplifiers, filters and bending modes.

A state takes part in a mode by the product of its elements of the right and the left eigenvector, its participation
factor; over all modes these sum to one. Position and velocity of the rotor sum to one mode of second order per axis.

Source: I. J. Perez-Arriaga, G. C. Verghese, F. C. Schweppe, Selective modal analysis, IEEE Trans. Power Apparatus and
Systems 101 (1982).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.linear import LinearSystem, rates_of

_NOT_OF_THE_ROTOR = ("flux", "circulating", "memory", "integral", "charge", "voltage", "held", "sensed", "derivative")
_LEAST_PARTICIPATION = 0.1
_LEAST_SHARE = 0.9  # of the motion of an output, relative to the mode that moves it most
_SAME_RATE = 1e-4
_REAL = 1e-7  # imaginary part over magnitude: rounding splits a double pole by its square root, 1e-8
_LEAST_SHAPE = 1e-3
_LEAST_ALIKE = 0.5  # modal assurance criterion of two shapes: 1 for the same, 0 for orthogonal ones


def rigid_pair(loop: LinearSystem, axis: str) -> NDArray[np.complex128] | None:
    """Rates of the two poles of the rigid rotor along an axis (1/s), None if there are no such two.

    Of the modes in which the rotor takes part and that move the output of this axis most, the rigid one is the slowest:
    bending modes and amplifiers are faster. Its pole is one of a complex pair, or real; then its partner is the next
    real pole of the same shape, unless a complex pair of this shape comes first: the partner is part of that.
    """
    poles, vectors = linalg.eig(loop.a)
    rates = rates_of(poles, loop.sample_time)
    # Two equal real poles, as of axes alike, are computed as a complex pair of about their size, or not, by rounding.
    rates = np.where(np.abs(rates.imag) <= _REAL * np.abs(rates), rates.real, rates)
    modes = np.flatnonzero((_participation(loop, vectors) > _LEAST_PARTICIPATION) & (rates.imag >= 0.0))
    modes = modes[np.argsort(np.abs(rates[modes]), kind="stable")]
    if not len(modes):
        return None
    spans = _spans(loop.c @ vectors[:, modes], rates[modes])
    along = np.eye(loop.outputs)[loop.output_names.index(axis)]
    share = np.array([np.linalg.norm(span.conj().T @ along) for span in spans])
    first = int(np.argmax(share > _LEAST_SHARE * share.max()))
    pair = rates[modes[first : first + 1]]
    if pair[0].imag > 0.0:
        return np.concatenate([pair, pair.conj()])
    shape = spans[first] @ (spans[first].conj().T @ along) / share[first]
    for number in range(first + 1, len(modes)):
        alike = np.linalg.norm(spans[number].conj().T @ shape) ** 2 > _LEAST_ALIKE
        if alike and not _same(rates[modes[number]], pair[0]):
            pair = np.concatenate([pair, rates[modes[number : number + 1]]])
            return pair if (pair.imag == 0.0).all() and (pair.real < 0.0).all() else None
    return None


def _spans(shapes: NDArray[np.complex128], rates: NDArray[np.complex128]) -> list[NDArray[np.complex128]]:
    """Orthonormal bases of the shapes of each mode and of those of the same rate: axes alike mix at random."""
    bases = []
    for rate in rates:
        left, singular, _ = np.linalg.svd(shapes[:, _same(rates, rate)], full_matrices=False)
        bases.append(left[:, singular > _LEAST_SHAPE * singular[0]])
    return bases


def _same(rates: NDArray[np.complex128] | complex, rate: complex) -> NDArray[np.bool_]:
    return np.asarray(np.abs(rates - rate) <= _SAME_RATE * np.abs(rate))


def _participation(loop: LinearSystem, vectors: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Of all states of the rotor in each mode."""
    own = [n for n, name in enumerate(loop.state_names) if not name.startswith(_NOT_OF_THE_ROTOR)]
    left = np.linalg.pinv(vectors)  # poles at z = 0 share eigenvectors
    return np.asarray(np.abs(vectors[own] * left[:, own].T).sum(axis=0))
