"""The Kalman gain of a model whose A, B and C are given: the one with the smallest one-step prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.levenberg_marquardt import minimise
from amb_core.identification.estimate.predictor import experiment_factor, experiments, innovations, kalman_gain
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import LARGEST_RADIUS

_ADDED = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)  # shares of the noise of each state, in turn until there is a gain
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
    first = _gain_of_noise(model) if start is None else start

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


def _gain_of_noise(model: StateSpaceModel) -> Arrays:
    """That of the Kalman filter for the noise of the model, with a little more noise where there is none for it.

    There is none if a zero of the noise model is on the unit circle, or too close to it for the Riccati equation to be
    solved: modes that the fit of the simulation has moved do that. Any stable predictor is a start.
    """
    # For innovations of variance 1: with the squares of positions in m the Riccati equation is too badly scaled.
    root = linalg.cholesky(model.innovation_covariance, lower=True)
    unit, gain = np.linalg.inv(root), model.k @ root
    noise = gain @ gain.T
    for share in _ADDED:
        with suppress(IdentificationError):
            added = share * np.diag(np.diag(noise))
            return kalman_gain(model.a, unit @ model.c, noise + added, np.eye(len(root)), gain) @ unit
    return kalman_gain(model.a, unit @ model.c, noise, np.eye(len(root)), gain) @ unit
