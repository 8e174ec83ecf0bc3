"""PEM on a known unstable bearing in closed loop: accuracy, descent, derivatives, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, StateSpaceModel, identify, pem, ssarx
from amb_core.identification.estimate.filter_bank import Modes, fit_gains
from amb_core.identification.estimate.predictor import innovations
from amb_core.identification.progress import SearchEnd
from tests.benchmarks.robust.misfit_plants import draw

if TYPE_CHECKING:
    from conftest import LinearBearing

BASE_NOISE = {"noise": 5e-8, "force": 0.3}  # m, N
TENFOLD_NOISE = {"noise": 5e-7, "force": 3.0}
BAND = {"kind": "multisine", "amplitude": 20e-6, "frequency_start": 1.0, "frequency_end": 2_000.0}


def start_of(bearing: LinearBearing, order: int = 6) -> StateSpaceModel:
    """A rough start for the data with base noise."""
    record = bearing.experiment(**BASE_NOISE)
    return ssarx(record.current, record.position, record.sample_time, order, past=30, future=8)


@pytest.mark.parametrize("excitation", [{}, BAND], ids=["square", "multisine"])
@pytest.mark.parametrize("order", [7, 10])
def test_the_unstable_poles_are_found_and_the_closed_loop_is_stable(
    bearing: LinearBearing, excitation: dict[str, object], order: int
) -> None:
    result = identify(bearing.experiment(**BASE_NOISE, **excitation), order, "pem")
    assert result.model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-4)
    assert result.stable


def test_it_is_better_than_n4sid_on_noisy_squares(bearing: LinearBearing) -> None:
    record = bearing.experiment(**TENFOLD_NOISE)
    ours, theirs = (identify(record, 10, method).model for method in ("pem", "n4sid"))
    assert ours.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-3)
    assert np.all(ours.fit > theirs.fit + 3.0)
    assert bearing.response_error(ours) < 0.1 * bearing.response_error(theirs)


def test_it_is_better_than_n4sid_on_band_limited_data(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE, **BAND)
    ours, theirs = (identify(record, 6, method).model for method in ("pem", "n4sid"))
    assert bearing.response_error(ours) < 0.005
    assert bearing.response_error(ours) < 0.7 * bearing.response_error(theirs)


def test_the_innovations_of_the_model_are_those_of_the_kalman_filter(bearing: LinearBearing) -> None:
    model = identify(bearing.experiment(**BASE_NOISE), 10, "pem").model
    expected = bearing.innovation_covariance(**BASE_NOISE)
    assert np.sqrt(np.diag(model.innovation_covariance)) == pytest.approx(
        np.sqrt(np.diag(expected)), rel=0.02
    )  # 20 000 samples scatter by 0.5 %
    assert np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))) < 1.0


def test_every_step_lowers_the_cost_and_the_search_converges(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE)
    steps: list[tuple[int, float]] = []
    start = start_of(bearing)
    model = pem(record.current, record.position, start, lambda *step: steps.append(step), most_iterations=100)
    iterations, costs = zip(*steps, strict=True)
    assert iterations[0] == 0
    assert 2 <= iterations[-1] < 60
    assert np.all(np.diff(costs) < 0.0)
    size = np.linalg.slogdet(model.innovation_covariance / np.outer(*[record.position.std(axis=0)] * 2))[1]
    assert costs[-1] == pytest.approx(0.5 * size, abs=1e-6)


def test_the_end_of_the_search_says_whether_it_converged(bearing: LinearBearing) -> None:
    record, ends = bearing.experiment(**BASE_NOISE), list[SearchEnd]()
    for most in (2, 100):
        pem(record.current, record.position, start_of(bearing), most_iterations=most, ended=ends.append)
    short, whole = ends
    assert (short.iterations, short.converged) == (2, False)
    assert whole.converged
    assert whole.left < 1e-5 < short.left


def test_a_summary_says_that_the_search_has_not_converged(bearing: LinearBearing) -> None:
    identification = identify(bearing.experiment(**BASE_NOISE), 10, "pem")
    assert identification.search is not None
    unfinished = replace(identification, search=SearchEnd(22, 0.031, converged=False))
    assert (
        "the search stopped after 22 steps and had not converged, a further step promises 3.1 % less squared error"
        in unfinished.summary
    )
    assert "converged" not in replace(identification, search=SearchEnd(9, 1e-6, converged=True)).summary


def test_starting_from_its_own_result_changes_next_to_nothing(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE)
    once = pem(record.current, record.position, start_of(bearing), most_iterations=100)
    twice = pem(record.current, record.position, once)
    size_once, size_twice = (np.linalg.slogdet(model.innovation_covariance)[1] for model in (once, twice))
    assert size_once - 1e-4 < size_twice <= size_once + 1e-9


@pytest.mark.parametrize("most", [2, 100], ids=["unfinished", "converged"])
def test_a_search_without_a_mode_at_the_limit_has_no_second_start(bearing: LinearBearing, most: int) -> None:
    record, start = bearing.experiment(**BASE_NOISE), start_of(bearing)
    once, allowed = (pem(record.current, record.position, start, None, most, second_start=on) for on in (False, True))
    for name in ("a", "b", "c", "k", "innovation_covariance", "initial_state"):
        assert np.array_equal(getattr(once, name), getattr(allowed, name))


def test_what_progress_raises_ends_the_search(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE)

    def cancel(iteration: int, cost: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pem(record.current, record.position, start_of(bearing), cancel)


@pytest.mark.parametrize("order", [2, 4])
def test_the_sensitivities_are_the_derivatives_of_the_cost(order: int) -> None:
    f = np.random.default_rng(2).normal(size=(order, order))
    check_slopes(0.9 * f / np.max(np.abs(np.linalg.eigvals(f))), places=order // 2)


def test_those_between_blocks_of_about_equal_modes_are_too() -> None:
    check_slopes(np.kron(np.diag([1.0, 1.01]), np.array([[0.7, 0.2], [-0.2, 0.7]])), places=4)


def check_slopes(f: np.ndarray, places: int) -> None:
    """Compare derivatives of squared errors, by the sensitivities, with differences, on random data."""
    random = np.random.default_rng(3)
    modes = Modes.of(f, random.normal(size=(2, len(f))))
    assert len(modes.places) == places
    inputs, outputs = random.normal(size=(500, 2)), random.normal(size=(500, 2))
    weight, step = np.array([[1.0, 0.0], [0.3, 2.0]]), 1e-6
    fit = fit_gains(modes, inputs, outputs, weight)

    def cost(change: np.ndarray) -> float:
        return float(np.sum(fit_gains(Modes.of(*modes.moved(change)), inputs, outputs, weight).errors ** 2))

    for slope, change in zip(
        -2.0 * fit.sensitivity.T @ fit.errors, step * np.eye(fit.sensitivity.shape[1]), strict=True
    ):
        assert slope == pytest.approx((cost(change) - cost(-change)) / (2.0 * step), abs=1e-7)


def test_a_search_of_alike_axes_does_not_stall() -> None:
    """Their modes are equal: in coordinates in which each stands alone, they may turn into one another at will."""
    plant = draw("honest", 246)
    record = plant.record(20_000, 2 * 246)
    assert record is not None
    result = identify(IdentificationData.from_record(record), plant.order, controller=plant.mild)
    assert result.search is not None and result.search.converged
    assert result.uncertainty is not None and result.uncertainty.distance < 0.1


def test_the_filter_bank_predicts_as_the_state_space_form_does() -> None:
    random = np.random.default_rng(2)
    inputs, outputs = random.normal(size=(500, 2)), random.normal(size=(500, 2))
    f = random.normal(size=(5, 5))
    modes = Modes.of(0.9 * f / np.max(np.abs(np.linalg.eigvals(f))), random.normal(size=(2, 5)))
    fit = fit_gains(modes, inputs, outputs, np.eye(2))
    a, b, c, k, initial_states = fit.matrices(2)
    errors = innovations(a, b, c, k, initial_states, inputs, outputs)
    assert np.cov(errors.T, bias=True) == pytest.approx(fit.covariance, rel=1e-9)  # with a constant in each output


def test_a_start_that_does_not_suit_is_refused(bearing: LinearBearing) -> None:
    record, start = bearing.experiment(**BASE_NOISE), start_of(bearing)
    with pytest.raises(IdentificationError, match=r"must have a stable predictor; its spectral radius is 1\.02"):
        pem(record.current, record.position, bearing.model)  # without Kalman gain
    with pytest.raises(IdentificationError, match="20 samples are too few for the 42 unknowns"):
        pem(record.current[:20], record.position[:20], start)
    single = replace(start, c=start.c[:1], d=start.d[:1], k=start.k[:, :1], output_names=("x",), output_units=("m",),
                     innovation_covariance=np.eye(1), output_offset=np.zeros(1))  # fmt: skip
    with pytest.raises(IdentificationError, match="2 inputs and 1 outputs"):
        pem(record.current, record.position, single)


def test_data_that_determine_no_model_are_refused(bearing: LinearBearing) -> None:
    record, start = bearing.experiment(**BASE_NOISE), start_of(bearing)
    with pytest.raises(IdentificationError, match="input 2 is constant"):
        pem(record.current * [1.0, 0.0], record.position, start)


@pytest.mark.parametrize("samples", [10_000, 20_000])
def test_a_search_from_two_about_equal_modes_of_the_predictor_does_not_stall(samples: int) -> None:
    """The pole 0.926 twice: in an orthonormal basis of that pair the search ended 8 standard deviations away."""
    plant = draw("honest", 6)
    data = IdentificationData.from_record(plant.record(samples, 12))
    identification = identify(data, plant.order, controller=plant.mild)
    assert identification.search is not None and identification.search.converged
    assert identification.uncertainty is not None and identification.uncertainty.distance < 0.5
