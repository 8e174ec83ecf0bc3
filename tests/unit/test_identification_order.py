"""The order of a model from data, and the fits on finite memory that it rests on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from amb_core.ground.errors import IdentificationError
from amb_core.identification import (
    IdentificationData,
    IdentificationProgress,
    OrderSelection,
    identify,
    select_order,
)
from amb_core.identification.estimate.filter_bank import Modes, fit_gains
from amb_core.identification.estimate.finite_memory import FiniteMemory, halves, memory_steps
from amb_core.identification.estimate.scaled_data import ScaledData
from amb_core.report.figures.order import order_chart


@pytest.fixture(scope="module")
def data(bearing) -> IdentificationData:
    """6000 samples of the bearing of order 6."""
    return IdentificationData.from_record(bearing.experiment(2e-8, force=0.1, frequency=20.0, duration=0.6))


@pytest.fixture(scope="module")
def selection(data: IdentificationData) -> OrderSelection:
    return select_order(data, (4, 5, 6, 7))


def test_the_criterion_of_schwarz_finds_the_order_of_the_bearing(selection: OrderSelection) -> None:
    assert selection.chosen == 6 and not selection.at_the_end
    assert selection.orders == (4, 5, 6, 7)


def test_the_progress_moves_with_every_iteration_of_a_search(data: IdentificationData) -> None:
    told: list[IdentificationProgress] = []
    select_order(data, (5, 6), progress=told.append)
    assert [now.done for now in told[:-1]] == list(range(len(told) - 1))
    assert all(now.done < now.total for now in told[:-1]) and told[-1].done == told[-1].total
    assert sum(now.cost is not None for now in told) >= 2  # iterations on all samples


def test_orders_that_the_inputs_do_not_excite_are_not_offered() -> None:
    """Three sines on each input are persistently exciting of order 5 to 6, which determines models of order 4."""
    time, random = np.arange(6_000) * 1e-3, np.random.default_rng(1)
    inputs = np.column_stack(
        [
            sum(np.sin(2.0 * np.pi * frequency * time + n) for n, frequency in enumerate(frequencies))
            for frequencies in ((3.0, 17.0, 41.0), (5.0, 23.0, 61.0))
        ]
    )
    mixed = inputs @ np.array([[1.0, 0.2], [0.1, 1.0]])
    outputs = lfilter(*butter(4, 0.2), mixed, axis=0) + 1e-4 * random.normal(size=mixed.shape)
    data = IdentificationData.from_arrays(inputs, outputs, 1e-3)
    assert select_order(data).orders == (1, 2, 3, 4)
    assert identify(data, "auto", orders=range(3, 15)).model.order <= 4
    with pytest.raises(IdentificationError, match=r"order 10 needs 10 to 20; .*, or ask for order 4$"):
        identify(data, "auto", orders=[10])


def test_the_criterion_of_akaike_takes_no_fewer_states(selection: OrderSelection) -> None:
    assert selection.best_by_aic >= 6


def test_criteria_count_from_their_least_value(selection: OrderSelection) -> None:
    assert selection.bic.min() == selection.aic.min() == 0.0
    assert selection.bic[-1] > selection.aic[-1]  # six parameters more cost log N each, not 2


def test_unknown_data_are_predicted_badly_with_too_few_states_and_no_better_with_more(
    selection: OrderSelection,
) -> None:
    error = dict(zip(selection.orders, selection.validation_error, strict=True))
    assert error[4] > 1.1 * error[6]
    assert error[7] > 0.95 * error[6]  # by chance of 6000 samples a few percent


def test_singular_values_fall_from_one(selection: OrderSelection) -> None:
    assert selection.singular_values[0] == 1.0
    assert np.all(np.diff(selection.singular_values) <= 0.0)


def test_a_choice_at_the_highest_order_tried_is_told(data: IdentificationData) -> None:
    assert select_order(data, (2, 3)).at_the_end


def test_orders_that_the_samples_do_not_suffice_for_are_not_tried(data: IdentificationData) -> None:
    short = data.window(3_000, 3_060)
    assert select_order(short).orders[-1] < 6
    with pytest.raises(IdentificationError, match="60 samples are too few for order 20"):
        select_order(short, (20,))


@pytest.mark.slow
def test_the_choice_is_the_same_for_data_in_parts(data: IdentificationData) -> None:
    parts = IdentificationData(tuple(data.window(*span).experiments[0] for span in ((0, 2_500), (2_500, 6_000))), 1e-4)
    assert select_order(parts, (5, 6)).chosen == 6


@pytest.mark.parametrize(("signals", "steps"), [(2, 200), (4, 200), (8, 200), (32, 62), (200, 10)])
def test_the_matrices_of_the_memory_do_not_grow_with_the_square_of_the_signals(signals: int, steps: int) -> None:
    """At most 2000 rows, 32 MB; 200 steps of 32 signals would take 330 MB for each of the seven matrices at a time."""
    assert memory_steps(40_000, signals) == steps


def test_predictors_within_the_memory_fit_as_on_all_samples() -> None:
    random = np.random.default_rng(3)
    inputs, outputs = random.normal(size=(2_000, 2)), random.normal(size=(2_000, 2))
    outputs[1:] += inputs[:-1]
    scaled = ScaledData.of(inputs, outputs)
    f = np.diag([0.5, -0.4]) + 0.1
    modes, weight = Modes.of(f, np.eye(2)), np.array([[1.0, 0.0], [0.2, 1.5]])
    first, second, *steps = halves(scaled, 60)
    ours = FiniteMemory.of(first + second, sum(steps), 2).best(modes, weight)
    # the first 60 samples, whose past is not known, do not count there
    theirs = fit_gains(modes, scaled.inputs, scaled.outputs, weight)
    np.testing.assert_allclose(ours.covariance, theirs.covariance, atol=0.02)
    np.testing.assert_allclose(ours.gains[..., :4], theirs.gains[..., :4], atol=0.02)


def test_sums_of_products_are_those_of_the_samples() -> None:
    random = np.random.default_rng(4)
    scaled = ScaledData.of(random.normal(size=(500, 2)), random.normal(size=(500, 2)))
    first, second, *steps = halves(scaled, 7)
    z = np.hstack([scaled.inputs, scaled.outputs])
    rows = np.hstack([z[7 - lag : 500 - lag] for lag in range(8)])
    np.testing.assert_allclose((first + second).reshape(32, 32), rows.T @ rows, atol=1e-10)
    assert sum(steps) == len(rows)


def test_the_figure_marks_the_choice_and_lists_the_numbers(selection: OrderSelection) -> None:
    chart = order_chart(selection)
    assert "chooses order 6" in chart.alt
    assert chart.table is not None and [row[0] for row in chart.table.rows] == [str(n) for n in selection.orders]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("squares", 7), ("multisine", 7), ("squares_noise10", 0)])
def test_order_10_is_found_for_the_plant_of_the_benchmark(name: str, seed: int) -> None:
    """Its predictor remembers more than the predictors of finite memory: by these alone, seeds 7 would give 12."""
    from tests.benchmarks.ident import plant

    record = plant.record(plant.DATA_SETS[name], seed)
    assert select_order(IdentificationData.from_record(record)).chosen == plant.ORDER
