"""The bound of Cramer and Rao on the scores: what no unbiased method can beat on the same data.

With white Gaussian innovations it is the covariance that `estimate_uncertainty` gives at the true model. Scores are
medians over parameters drawn with that covariance, close to the truth and extrapolated, so that they are those of the
linearised problem.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 7.4 and 9.4.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.identification import IdentificationData, StateSpaceModel, estimate_uncertainty
from tests.benchmarks.ident import plant
from tests.benchmarks.ident.cases import CASES
from tests.benchmarks.ident.scores import score

_DRAWS = 50
_CLOSENESS = 1e-2  # of the drawn models to the truth, relative to the bound
_FIELDS = ("a", "b", "c", "k")

Parameters = NDArray[np.float64]


def bound(data_set: str, steps: int, seed: int = 0) -> dict[str, float]:
    """Scores that are percentages, as `scores.score` gives them."""
    true = CASES[data_set].true
    data = IdentificationData.from_arrays(*CASES[data_set].data(seed, steps), true.sample_time)
    directions = estimate_uncertainty(true, data).root
    random = np.random.default_rng(seed)
    draws = [_moved(true, _CLOSENESS * directions @ random.normal(size=directions.shape[1])) for _ in range(_DRAWS)]
    scores = [score((model.a, model.b, model.c), data_set) for model in draws]
    medians = {name: statistics.median(float(one[name]) for one in scores) for name in scores[0]}
    fits = {name: 100.0 - (100.0 - medians[name]) / _CLOSENESS for name in ("fit_squares", "fit_multisine")}
    return fits | {name: medians[name] / _CLOSENESS for name in ("frf_max_percent", "frf_below_500_percent")}


def _moved(model: StateSpaceModel, change: Parameters) -> StateSpaceModel:
    """The model with its matrices changed."""
    matrices, start = {}, 0
    for name in _FIELDS:
        matrix = getattr(model, name)
        matrices[name] = matrix + change[start : start + matrix.size].reshape(matrix.shape)
        start += matrix.size
    return replace(model, **matrices)


if __name__ == "__main__":
    for name in CASES:
        print(name, bound(name, plant.STEPS))
