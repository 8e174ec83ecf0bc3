"""Confidence regions of poles: alone they are ellipses, close ones are taken together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from amb_core.identification.uncertainty.poles import PoleGroup, pole_groups

RUNS = 200
SIZE = 1e-4  # deviation of every entry of A


def every_entry(order: int) -> np.ndarray:
    """Independent changes of all entries of A, shape (n^2, n, n)."""
    return SIZE * np.eye(order**2).reshape(-1, order, order)


def rotation(pole: complex) -> np.ndarray:
    """A 2x2 matrix with a pair of complex conjugate poles."""
    return np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])


def block(*matrices: np.ndarray) -> np.ndarray:
    """A block diagonal matrix of 2x2 matrices."""
    whole = np.zeros((2 * len(matrices), 2 * len(matrices)))
    for place, matrix in enumerate(matrices):
        whole[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] = matrix
    return whole


def inside(pole: complex, groups: list[PoleGroup], confidence: float = 0.99) -> bool:
    """Whether the group nearest to a true pole holds it."""
    return min(groups, key=lambda group: np.abs(group.poles - pole).min()).holds(pole, confidence)


@pytest.mark.parametrize(
    ("true", "poles"),
    [
        (block(rotation(1.02 + 1e-4j), rotation(0.9 + 0.3j)), [1.02 + 1e-4j, 0.9 + 0.3j]),
        (np.diag([1.02, 1.02, 0.5]), [1.02]),
        (np.diag([1.02, 1.0201, 0.5]), [1.02, 1.0201]),
        (block(rotation(1.02 + 0.1j), rotation(1.0201 + 0.1j)), [1.02 + 0.1j, 1.0201 + 0.1j]),
    ],
    ids=["a pair near the real axis", "a double pole", "two real poles", "two close pairs"],
)
def test_true_poles_lie_in_the_region_of_their_group(true: np.ndarray, poles: list[complex]) -> None:
    """With 1 % outside, fewer than 194 of 200 inside would have a probability of 0.4 %."""
    random, changes = np.random.default_rng(0), every_entry(len(true))
    counts = np.zeros(len(poles), dtype=int)
    for _ in range(RUNS):
        groups = pole_groups(true + np.tensordot(random.normal(size=len(changes)), changes, axes=1), changes)
        counts += [inside(pole, groups) for pole in poles]
    assert counts.min() >= 194


def test_the_derivatives_of_close_poles_do_not_hold_the_true_ones() -> None:
    """Why there are groups: the ellipse of the nearest estimated pole misses far more than 1 % of the runs."""
    true, pole = rotation(1.02 + 1e-4j), 1.02 + 1e-4j
    random, changes, held = np.random.default_rng(0), every_entry(2), 0
    for _ in range(RUNS):
        values, right = np.linalg.eig(true + np.tensordot(random.normal(size=4), changes, axes=1))
        nearest = int(np.argmin(np.abs(values - pole)))
        moved = np.einsum("n,qnm,m->q", np.linalg.inv(right)[nearest], changes, right[:, nearest])
        parts, error = np.array([moved.real, moved.imag]), values[nearest] - pole
        place = np.array([error.real, error.imag])
        held += place @ np.linalg.pinv(parts @ parts.T) @ place <= chi2.ppf(0.99, 2) and bool(
            np.iscomplex(values[nearest])
        )
    assert held < 150


def test_a_pole_alone_has_the_ellipse_of_its_derivative() -> None:
    a = block(rotation(1.0 + 0.2j), np.diag([0.5, 0.1]))
    changes = every_entry(4)
    complex_pair, conjugate, real, _ = pole_groups(a, changes)
    assert complex_pair.poles == pytest.approx([1.0 + 0.2j])
    assert conjugate.poles == pytest.approx([1.0 - 0.2j])
    assert real.poles == pytest.approx([0.5])
    # Each part of the complex pole is the mean of two independent entries, the real pole is an entry.
    assert complex_pair.distance(1.0 + 0.2j + SIZE) == pytest.approx(np.sqrt(2.0))
    assert complex_pair.distance(1.0 + 0.2j - 2j * SIZE) == pytest.approx(2.0 * np.sqrt(2.0))
    assert real.distance(0.5 + 3.0 * SIZE) == pytest.approx(3.0)
    assert real.distance(0.5 + 1e-6j) == np.inf
    assert real.magnitudes(2.0) == pytest.approx((0.5 - 2.0 * SIZE, 0.5 + 2.0 * SIZE))


def test_magnitudes_of_a_double_pole_are_those_of_the_worst_symmetric_change() -> None:
    """Eigenvalues of 1.02 I + dF with |dF| (Frobenius) at most 3 deviations lie within 3 deviations."""
    (group,) = pole_groups(1.02 * np.eye(2), every_entry(2))
    low, high = group.magnitudes(3.0)
    assert high == pytest.approx(1.02 + 3.0 * SIZE, abs=1e-9)
    assert low == pytest.approx(1.02 - 3.0 * SIZE, abs=1e-9)


def test_a_badly_determined_fast_pole_does_not_join_the_slow_ones() -> None:
    changes = every_entry(3)
    changes[8] *= 1e3  # the entry of the fast pole
    groups = pole_groups(np.diag([1.02, 0.9, 0.3]), changes)
    assert [len(group.poles) for group in groups] == [1, 1, 1]
