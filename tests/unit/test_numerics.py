"""Numerics that the methods of identification share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.linear.numerics import thin_svd

RARE = Path(__file__).parent / "data" / "slow_svd.npz"
"""Sensitivities of a search for a bearing of order 10, for which gesdd of OpenBLAS 0.3 does not converge."""


@pytest.mark.parametrize("rare", [True, False])
def test_singular_values_are_found_for_any_finite_matrix(rare: bool) -> None:
    with np.load(RARE) as kept:
        matrix = kept["matrix"] if rare else np.random.default_rng(1).normal(size=(30, 4))
    left, singular, right = thin_svd(matrix)
    np.testing.assert_allclose((left * singular) @ right, matrix, atol=1e-13)
    assert np.all(np.diff(singular) <= 0.0)
