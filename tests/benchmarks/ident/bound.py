"""The bound of Cramer and Rao on the scores: what no unbiased method can beat on the same data.

With white Gaussian innovations the covariance of the parameters of a model in innovations form is at least the inverse
of J'J, where J holds the derivatives of the weighted one-step prediction errors at the true model; the directions that
only change coordinates drop out. Scores are medians over parameters drawn with that covariance, close to the truth and
extrapolated, so that they are those of the linearised problem.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 7.4 and 9.4.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np
import plant
from numpy.typing import NDArray
from scores import score

from amb_core.identification import StateSpaceModel
from amb_core.identification.predictor import innovations
from amb_core.records import LoopRecord

_DRAWS = 50
_CLOSENESS = 1e-2  # of the drawn models to the truth, relative to the bound
_STEP = 1e-5  # of the differences, for states of variance 1
_FIELDS = ("a", "b", "c", "k")

Parameters = NDArray[np.float64]


def bound(data_set: str, seed: int = 0) -> dict[str, float]:
    """Scores that are percentages, as `scores.score` gives them."""
    experiment = plant.DATA_SETS[data_set]
    record = plant.record(experiment, seed)
    true = _scaled(plant.true_model(experiment.noise), record)
    directions = _directions(true, record)
    random = np.random.default_rng(seed)
    draws = [_moved(true, _CLOSENESS * directions @ random.normal(size=directions.shape[1])) for _ in range(_DRAWS)]
    scores = [score((model.a, model.b, model.c)) for model in draws]
    medians = {name: statistics.median(float(one[name]) for one in scores) for name in scores[0]}
    fits = {name: 100.0 - (100.0 - medians[name]) / _CLOSENESS for name in ("fit_squares", "fit_multisine")}
    return fits | {name: medians[name] / _CLOSENESS for name in ("frf_max_percent", "frf_below_500_percent")}


def _scaled(model: StateSpaceModel, record: LoopRecord) -> StateSpaceModel:
    """The model with independent states of variance 1 on the data."""
    f, inputs = model.a - model.k @ model.c, np.hstack([record.current, record.position])
    nothing, zero = np.zeros((model.order, model.order)), np.zeros((record.steps, model.order))
    states = innovations(
        f, np.hstack([model.b, model.k]), np.eye(model.order), nothing, np.zeros(model.order), inputs, zero
    )
    basis = np.asarray(np.linalg.qr(states, mode="r")).T / np.sqrt(record.steps)
    a, b, k = (np.linalg.solve(basis, matrix) for matrix in (model.a @ basis, model.b, model.k))
    return replace(model, a=a, b=b, c=model.c @ basis, k=k)


def _directions(model: StateSpaceModel, record: LoopRecord) -> NDArray[np.float64]:
    """Root of the parameters' covariance, shape (parameters, n (2 p + m))."""
    weight = np.linalg.inv(np.linalg.cholesky(model.innovation_covariance))
    sizes = np.concatenate([np.full(getattr(model, name).size, np.abs(getattr(model, name)).max()) for name in _FIELDS])

    def errors(change: Parameters) -> NDArray[np.float64]:
        moved = _moved(model, change)
        found = innovations(moved.a, moved.b, moved.c, moved.k, np.zeros(model.order), record.current, record.position)
        return (found @ weight.T).ravel()

    jacobian = np.empty((2 * record.steps, len(sizes)))
    for index, size in enumerate(sizes):
        change = np.zeros(len(sizes))
        change[index] = _STEP * size
        jacobian[:, index] = (errors(change) - errors(-change)) / (2.0 * _STEP)
    norms = np.linalg.norm(jacobian, axis=0)
    _, singular, right = np.linalg.svd(np.linalg.qr(jacobian / norms, mode="r"))
    seen = model.order * (2 * len(model.c) + model.b.shape[1])
    return (right[:seen].T / singular[:seen]) * (sizes / norms)[:, np.newaxis]


def _moved(model: StateSpaceModel, change: Parameters) -> StateSpaceModel:
    """The model with its matrices changed."""
    matrices, start = {}, 0
    for name in _FIELDS:
        matrix = getattr(model, name)
        matrices[name] = matrix + change[start : start + matrix.size].reshape(matrix.shape)
        start += matrix.size
    return replace(model, **matrices)


if __name__ == "__main__":
    for name in plant.DATA_SETS:
        print(name, bound(name))
