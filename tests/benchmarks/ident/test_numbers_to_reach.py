"""One seed of each data set of the benchmark against the numbers to reach; `run.py` takes the medians over 20."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.identification import StateSpaceModel, pem, ssarx
from tests.benchmarks.ident import plant
from tests.benchmarks.ident.cases import CASES
from tests.benchmarks.ident.scores import innovation_ratio, score

# Least fit on squares and on the multisine, largest error of the frequency response (percent).
NUMBERS = {
    "squares": (99.98, 99.85, 2.5),
    "multisine": (99.7, 99.7, 1.5),
    "squares_noise10": (99.85, 97.5, 25.0),
    "rotor4": (99.3, 99.3, 4.5),
    "siso": (99.7, 99.7, 12.0),
}


def identified(data_set: str, order: int | None = None) -> StateSpaceModel:
    """The model of the first seed, by the default method; of the order of the plant if none is given."""
    case = CASES[data_set]
    inputs, outputs = case.data(0)
    return pem(inputs, outputs, ssarx(inputs, outputs, plant.SAMPLE_TIME, order or case.true.order))


@pytest.mark.slow
@pytest.mark.parametrize("data_set", NUMBERS)
def test_the_model_is_as_close_to_the_plant_as_the_benchmark_asks(data_set: str) -> None:
    model = identified(data_set)
    scores = score((model.a, model.b, model.c), data_set)
    fit_squares, fit_multisine, response_error = NUMBERS[data_set]
    assert scores["fit_squares"] >= fit_squares
    assert scores["fit_multisine"] >= fit_multisine
    assert scores["frf_max_percent"] <= response_error
    assert scores["unstable_poles_right"]
    assert scores["closed_loop_stable"]
    assert innovation_ratio(model.innovation_covariance, data_set) == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("data_set", plant.DATA_SETS)
def test_the_bayesian_criterion_picks_the_order_of_the_plant(data_set: str) -> None:
    orders = (8, 9, 10, 11, 12)
    criteria = []
    for order in orders:
        size = np.linalg.slogdet(identified(data_set, order).innovation_covariance * 1e12)[1]
        criteria.append(plant.STEPS * size + 6 * order * np.log(plant.STEPS))  # n (2 p + m) parameters
    assert orders[int(np.argmin(criteria))] == plant.ORDER
