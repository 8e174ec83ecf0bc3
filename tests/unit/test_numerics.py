"""Numerics that the methods of identification share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.linear.numerics import thin_svd, with_rows

RARE = Path(__file__).parent / "data" / "slow_svd.npz"
"""Sensitivities of a search for a bearing of order 10, for which gesdd of OpenBLAS 0.3 does not converge."""


@pytest.mark.parametrize("rare", [True, False])
def test_singular_values_are_found_for_any_finite_matrix(rare: bool) -> None:
    with np.load(RARE) as kept:
        matrix = kept["matrix"] if rare else np.random.default_rng(1).normal(size=(30, 4))
    left, singular, right = thin_svd(matrix)
    np.testing.assert_allclose((left * singular) @ right, matrix, atol=1e-13)
    assert np.all(np.diff(singular) <= 0.0)


@pytest.mark.parametrize("blocks", [(200,), (3, 5, 60, 1, 100), (70, 0, 20)])
def test_a_triangle_with_rows_added_is_the_factor_of_all_rows(blocks: tuple[int, ...]) -> None:
    random, columns = np.random.default_rng(2), 23
    parts = [random.normal(size=(rows, columns)) * 10.0 ** random.uniform(-6.0, 6.0, columns) for rows in blocks]
    triangle = np.zeros((0, columns))
    for part in parts:
        kept = triangle.copy(), part.copy()
        factor = with_rows(triangle, part)
        np.testing.assert_array_equal(triangle, kept[0])  # neither is changed
        np.testing.assert_array_equal(part, kept[1])
        triangle = factor
    right = np.linalg.qr(np.vstack(parts), mode="r")
    np.testing.assert_array_equal(triangle, np.triu(triangle))
    size = np.linalg.norm(right, axis=0)
    np.testing.assert_allclose(np.abs(triangle) / size, np.abs(right) / size, atol=1e-14)


def test_an_added_value_that_is_not_a_number_shows_in_the_triangle() -> None:
    rows = np.random.default_rng(3).normal(size=(40, 4))
    rows[30, 2] = np.nan
    assert np.isnan(with_rows(with_rows(np.zeros((0, 4)), rows[:20]), rows[20:])).any()
