"""The distribution of the largest root of a Wishart matrix, against chi-square and against drawn matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from amb_core.identification.validation import largest_root


def test_of_a_single_column_it_is_chi_square() -> None:
    values = np.array([0.5, 4.0, 30.0, 90.0])
    np.testing.assert_allclose(largest_root.survival(values, 4, 1), special.chdtrc(4, values))
    assert largest_root.mean(4, 1) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(("rows", "columns"), [(8, 2), (12, 3), (16, 4), (24, 6), (2, 5)])
def test_of_several_columns_it_is_that_of_drawn_matrices(rows: int, columns: int) -> None:
    drawn = np.random.default_rng(1).standard_normal((20_000, rows, columns))
    roots = np.linalg.norm(drawn, 2, axis=(1, 2)) ** 2
    for share in (0.5, 0.1, 0.01):
        probability = float(largest_root.survival(np.quantile(roots, 1.0 - share), rows, columns))
        assert probability == pytest.approx(share, abs=4.0 * np.sqrt(share / len(roots)))
    assert largest_root.mean(rows, columns) == pytest.approx(roots.mean(), rel=0.1)


def test_tails_fall_to_rounding_and_more_columns_give_an_upper_bound() -> None:
    far = largest_root.survival(np.linspace(20.0, 120.0, 50), 12, 3)
    assert np.all(np.diff(far) <= 1e-12) and 0.0 <= far[-1] < 1e-10
    assert largest_root.survival(60.0, 20, 10) >= 0.99
