"""The gain from which the noise part is fitted, after the fit of a simulation has moved the poles."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.identification.focus.gain import fit_kalman_gain
from amb_core.linear.model.state_space import StateSpaceModel


@pytest.mark.parametrize("zero", [1.0, -1.0, 0.5, 1.5])
def test_a_noise_model_with_a_zero_anywhere_gives_a_stable_predictor(zero: float) -> None:
    """A zero on the unit circle leaves the Riccati equation without a stabilising solution."""
    one, steps = np.ones((1, 1)), 500
    model = StateSpaceModel(
        a=0.9 * one, b=one, c=one, d=0.0 * one, k=(0.9 - zero) * one, innovation_covariance=one,
        input_offset=np.zeros(1), output_offset=np.zeros(1), initial_state=np.zeros(1),
        sample_time=1e-4, input_names=("i",), output_names=("x",),
    )  # fmt: skip
    outputs = np.random.default_rng(1).normal(size=(steps, 1))
    found = fit_kalman_gain(model, [np.zeros((steps, 1))], [outputs], np.zeros((1, 1)))
    assert np.abs(np.linalg.eigvals(found.a - found.k @ found.c)).max() < 1.0
