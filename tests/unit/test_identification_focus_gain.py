"""The Kalman gain that simulation focus estimates last."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.identification.focus.gain import fit_kalman_gain
from amb_core.linear.model.state_space import StateSpaceModel

ORDER, AXES = 8, 2


def model_of(seed: int, unit: float) -> StateSpaceModel:
    """A stable plant whose own gain makes an unstable predictor; its outputs are in a unit, and of unequal accuracy."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(ORDER, ORDER))
    spread = np.array([1e-2, 1.0])
    return StateSpaceModel(
        a=0.99 * a / np.abs(np.linalg.eigvals(a)).max(),
        b=random.normal(size=(ORDER, AXES)),
        c=unit * random.normal(size=(AXES, ORDER)),
        d=np.zeros((AXES, AXES)),
        k=random.normal(size=(ORDER, AXES)) / (unit * spread),
        innovation_covariance=np.diag((unit * spread) ** 2),
        input_offset=np.zeros(AXES),
        output_offset=np.zeros(AXES),
        initial_state=np.zeros(ORDER),
        sample_time=1e-4,
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_gain_does_not_depend_on_the_unit_of_the_outputs(seed: int) -> None:
    """In m, squared innovations of a simulated bearing are 1e-24, next to squared states of 1."""
    random = np.random.default_rng(100 + seed)
    inputs, outputs = random.normal(size=(2, 400, AXES))
    poles = [
        fit_kalman_gain(model_of(seed, unit), [inputs], [unit * outputs], np.zeros((1, ORDER))).k * unit
        for unit in (1.0, 1e-11)
    ]
    assert np.isfinite(poles[0]).all()
    np.testing.assert_allclose(poles[1], poles[0], rtol=1e-3, atol=1e-6 * np.abs(poles[0]).max())
    radius = np.abs(np.linalg.eigvals(model_of(seed, 1.0).a - poles[0] @ model_of(seed, 1.0).c)).max()
    assert radius < 1.0


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
