"""The search behind simulation focus: damped least squares, and local coordinates of state-space models."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel
from amb_core.identification.estimate.levenberg_marquardt import minimise
from amb_core.identification.estimate.local_coordinates import balanced_predictor, local_directions
from amb_core.identification.estimate.predictor import kalman_gain

if TYPE_CHECKING:
    from conftest import LinearBearing


def rosenbrock(point: np.ndarray) -> np.ndarray:
    return np.array([1.0 - point[0], 10.0 * (point[1] - point[0] ** 2)])


def derivatives(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[1.0, 0.0], [20.0 * point[0], -10.0]]), rosenbrock(point)


def search(**settings: object) -> tuple[np.ndarray, list[float]]:
    """The point found from the usual start, and the sums of squares on the way."""
    told: list[float] = []
    minimum = minimise(
        np.array([-1.2, 1.0]),
        lambda point: float(np.sum(rosenbrock(point) ** 2)),
        derivatives,
        settings.pop("move", lambda point, step: point + step),
        lambda iteration, squares: told.append(squares),
        **{"most_iterations": 60, **settings},
    ).point
    return minimum, told


def test_the_valley_of_rosenbrock_is_followed_to_its_lowest_point() -> None:
    minimum, told = search()
    assert minimum == pytest.approx([1.0, 1.0], abs=1e-6)
    assert np.all(np.diff(told) <= 0.0)


def test_points_that_are_not_allowed_are_stepped_around() -> None:
    minimum, _ = search(move=lambda point, step: None if (point + step)[0] > 0.5 else point + step)
    assert -1.2 < minimum[0] <= 0.5


def test_the_search_ends_after_the_steps_that_it_may_try() -> None:
    _, told = search(most_iterations=3)
    assert len(told) == 4  # the start, and three steps


def test_local_directions_leave_out_changes_of_the_states_alone() -> None:
    random = np.random.default_rng(1)
    n, m, p = 5, 3, 2
    a, b, c = random.normal(size=(n, n)), random.normal(size=(n, m)), random.normal(size=(p, n))
    of_a, of_b, of_c = local_directions(a, b, c)
    directions = np.vstack([of_a.reshape(n * n, -1), of_b.reshape(n * m, -1), of_c.reshape(p * n, -1)])
    assert directions.shape[1] == n * (m + p)
    assert directions.T @ directions == pytest.approx(np.eye(n * (m + p)), abs=1e-12)
    x = random.normal(size=(n, n))
    similar = np.concatenate([(x @ a - a @ x).ravel(), (x @ b).ravel(), (-c @ x).ravel()])
    assert directions.T @ similar == pytest.approx(np.zeros(n * (m + p)), abs=1e-11)


def test_balancing_changes_the_states_only(bearing: LinearBearing) -> None:
    bearing_model = bearing.model
    gain = kalman_gain(
        bearing_model.a, bearing_model.c, bearing_model.b @ bearing_model.b.T, np.eye(2), np.zeros((6, 2))
    )
    scale = np.logspace(-3.0, 3.0, 6)
    model = replace(
        bearing_model,
        a=bearing_model.a * scale[:, np.newaxis] / scale,
        b=bearing_model.b * scale[:, np.newaxis],
        c=bearing_model.c / scale,
        k=gain * scale[:, np.newaxis],
        initial_state=scale,
    )
    balanced = balanced_predictor(model, np.ones(2))
    assert np.max(np.abs(balanced.a)) < 2.0
    for response, right in zip(_responses(balanced), _responses(model), strict=True):
        assert response == pytest.approx(right, rel=1e-5, abs=1e-8 * np.max(np.abs(right)))


def test_a_predictor_that_is_not_stable_is_not_balanced(bearing: LinearBearing) -> None:
    with pytest.raises(IdentificationError, match=r"stable predictor; its spectral radius is 1\.02"):
        balanced_predictor(bearing.model, np.ones(2))


def _responses(model: StateSpaceModel) -> list[np.ndarray]:
    """Answers to the inputs, the innovations and the initial state at the first steps."""
    from_all = np.column_stack([model.b, model.k, model.initial_state])
    return [model.c @ np.linalg.matrix_power(model.a, steps) @ from_all for steps in range(2, 10)]
