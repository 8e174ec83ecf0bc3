"""A search that cannot move ends, without a division by zero and without a warning of NumPy or SciPy."""

from __future__ import annotations

import warnings
from itertools import count

import numpy as np
import pytest
from scipy import linalg

from amb_core.data.experiments.drift.autoregression import LAGS, fit
from amb_core.identification.estimate.levenberg_marquardt import damped_step, minimise

pytestmark = pytest.mark.filterwarnings("error")


@pytest.mark.parametrize("size", [0.0, 1e-200])
def test_there_is_no_step_where_no_parameter_has_an_effect(size: float) -> None:
    step, promised, possible = damped_step(np.full((5, 2), size) * np.eye(5, 2), np.ones(5), 0.01)
    assert np.isfinite(step).all()
    assert np.isfinite([promised, possible]).all()


def test_errors_of_an_exact_fit_promise_nothing() -> None:
    _, promised, possible = damped_step(np.eye(3, 2), np.zeros(3), 0.01)
    assert promised == possible == 0.0


def test_a_search_of_refused_steps_ends_before_a_step_is_lost_in_rounding() -> None:
    """Ten refused steps leave a damping that rounds the promise to zero; the next point is better by rounding."""
    costs = count()

    def squares(_: float) -> float:
        return 1.0 - 1e-16 if next(costs) > 12 else 1.0

    end = minimise(0.0, squares, lambda _: (np.eye(3, 1), np.ones(3)), lambda point, step: point + float(step[0])).point
    assert abs(end) < 1e-6


@pytest.mark.parametrize(("least_progress", "iterations"), [(0.0, 30), (1e-6, 5)])
def test_a_search_whose_steps_do_not_give_what_they_promise_ends(least_progress: float, iterations: int) -> None:
    costs = count()
    search = minimise(
        0.0,
        lambda _: 1.0 - 1e-9 * next(costs),
        lambda _: (np.eye(3, 1), np.ones(3)),
        lambda point, step: point + float(step[0]),
        least_progress=least_progress,
    )
    assert (search.iterations, search.left) == (iterations, pytest.approx(1.0 / 3.0))


def test_signals_of_very_different_size_are_no_ill_condition() -> None:
    signals = np.random.default_rng(1).normal(size=(2_000, 2))
    reference = fit([signals], 1).coefficients.reshape(LAGS, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", linalg.LinAlgWarning)
        small = fit([signals * [1e-9, 1.0]], 1).coefficients.reshape(LAGS, 2)
    np.testing.assert_allclose(small * [1e-9, 1.0], reference, rtol=1e-6, atol=1e-9)
