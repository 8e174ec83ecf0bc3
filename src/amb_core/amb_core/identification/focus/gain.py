"""The Kalman gain of a model whose A, B and C are given: the one with the smallest one-step prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.estimate.levenberg_marquardt import minimise
from amb_core.identification.estimate.predictor import experiment_factor, experiments, filter_gain, innovations
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import LARGEST_RADIUS

_LEAST_GAIN = 1e-4  # relative decrease of the squared errors at which the search ends
_MOST_ITERATIONS = 15

Arrays = NDArray[np.float64]


def fit_kalman_gain(
    model: StateSpaceModel,
    inputs: Sequence[Arrays],
    outputs: Sequence[Arrays],
    initial_states: Arrays,
    start: Arrays | None = None,
) -> StateSpaceModel:
    """The model with new estimates of K and of the covariance of the innovations; everything else is unchanged.

    Errors are weighted by the inverse of their covariance with the gain at the start. This is by default the model's
    own K if it makes a stable predictor, otherwise the gain of the Kalman filter for the same noise.

    Parameters
    ----------
    model : StateSpaceModel
        Gives A, B and C, and K and the covariance of the innovations to start from.
    inputs, outputs : sequences of ndarray, shapes (steps, m), (steps, p)
        Currents (A) and positions (m) of each experiment, without the offsets of the model.
    initial_states : ndarray, shape (experiments, n)
        State at the first sample of each.
    start : ndarray, shape (n, p), optional
        Gain to start from, which makes a stable predictor (1/m).

    Raises
    ------
    IdentificationError
        If no gain makes a stable predictor.
    """
    lengths = [len(part) for part in inputs]
    joined_inputs, joined_outputs = np.vstack(inputs), np.vstack(outputs)
    first = filter_gain(model.a, model.c, model.k, model.innovation_covariance) if start is None else start

    def errors_of(k: Arrays) -> Arrays:
        return innovations(model.a, model.b, model.c, k, initial_states, joined_inputs, joined_outputs, lengths)

    errors = errors_of(first)
    weight = np.linalg.inv(linalg.cholesky(errors.T @ errors / len(errors), lower=True))

    def squares(k: Arrays) -> float:
        return float(np.sum((errors_of(k) @ weight.T) ** 2))

    def linearise(k: Arrays) -> tuple[Arrays, Arrays]:
        f, errors = model.a - k @ model.c, errors_of(k)
        # K acts on the errors as an input matrix does on inputs.
        factors = [
            experiment_factor(f, weight @ model.c, errors[part], errors[part] @ weight.T)
            for part in experiments(len(errors), lengths)
        ]
        rows = np.vstack([factor[:, model.order :] for factor in factors])
        return rows[:, :-1], rows[:, -1]

    def move(k: Arrays, step: Arrays) -> Arrays | None:
        moved = k + step.reshape(k.T.shape).T
        radius = float(np.max(np.abs(np.linalg.eigvals(model.a - moved @ model.c))))
        return moved if radius < LARGEST_RADIUS else None

    k = minimise(first, squares, linearise, move, most_iterations=_MOST_ITERATIONS, least_gain=_LEAST_GAIN).point
    errors = errors_of(k)
    return replace(model, k=k, innovation_covariance=errors.T @ errors / len(errors))
