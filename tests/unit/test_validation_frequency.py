"""Frequency responses without a model: right where data determine them, with honest deviations, refused elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.experiments import merge
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, StateSpaceModel, pem, ssarx
from amb_core.identification.frequency_response import response_of
from amb_core.identification.nonparametric import NonparametricEstimate, estimate_response
from amb_core.identification.uncertainty import estimate_uncertainty
from amb_core.identification.validation import compare_responses
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, linearize
from tests.linear_process import LinearProcess

NOISE, FORCE = 2e-8, 0.1  # m, N: rms on sensors and rotor
GAIN = np.array([[1.5, 0.4], [-0.3, 2.0]])


@pytest.fixture(scope="module")
def data(bearing) -> IdentificationData:
    """Squares of 5 Hz on x, then on y."""
    return IdentificationData.from_record(bearing.experiment(NOISE, force=FORCE))


def relative_error(estimate: NonparametricEstimate, model: StateSpaceModel) -> np.ndarray:
    true = response_of(model, estimate.response.frequency).response
    return np.linalg.norm(estimate.response.response - true, 2, axis=(1, 2)) / np.linalg.norm(true, 2, axis=(1, 2))


def noise_experiment(reference: np.ndarray, seed: int = 0, noise: float = 0.1) -> IdentificationData:
    """A plant y = GAIN lowpass(u) + v under the feedback u = r - 0.5 y of the sample before."""
    random = np.random.default_rng(seed)
    v = noise * random.normal(size=reference.shape)
    u, y, state = np.empty_like(reference), np.empty_like(reference), np.zeros(2)
    for step, wanted in enumerate(reference):
        y[step] = GAIN @ state + v[step]
        u[step] = wanted - 0.5 * y[step]
        state = 0.6 * state + 0.4 * u[step]
    return IdentificationData.from_arrays(u, y, 1e-3, reference=reference)


def true_response(frequency: np.ndarray) -> np.ndarray:
    delay = np.exp(-2j * np.pi * frequency * 1e-3)[:, np.newaxis, np.newaxis]
    return GAIN * 0.4 * delay / (1.0 - 0.6 * delay)


def test_squares_are_averaged_over_their_settled_periods(data: IdentificationData, bearing) -> None:
    """Of 5 periods on each axis the first settles; even multiples of 5 Hz have no power."""
    estimate = estimate_response(data)
    assert estimate.response.label == "average of 8 periods of 0.2 s"
    assert estimate.response.frequency[:3] == pytest.approx([5.0, 15.0, 25.0])
    low = estimate.response.frequency < 100.0
    assert relative_error(estimate, bearing.model)[low].max() < 0.01


def test_without_noise_averages_of_periods_are_free_of_leakage(bearing) -> None:
    quiet = IdentificationData.from_record(bearing.experiment(0.0))
    estimate = estimate_response(quiet)
    assert estimate.response.frequency[-1] > 4_900.0
    assert relative_error(estimate, bearing.model)[estimate.response.frequency < 1_000.0].max() < 1e-4


def test_deviations_are_those_of_the_errors() -> None:
    """|error|^2 / variance has the mean 1; over some thousand values it is met within a few percent."""
    for periodic in (True, False):
        random = np.random.default_rng(3)
        ratios = []
        for seed in range(2):
            length = 400 if periodic else 4_000
            axes = [np.tile(random.normal(size=(length, 2)), (12 if periodic else 1, 1)) for _ in range(2)]
            estimate = estimate_response(
                merge([noise_experiment(reference, seed + 10 * axis) for axis, reference in enumerate(axes)])
            )
            error = estimate.response.response - true_response(estimate.response.frequency)
            ratios.append(np.abs(error) ** 2 / estimate.variance)
        assert np.concatenate(ratios).mean() == pytest.approx(1.0, abs=0.2)
        assert np.mean(np.concatenate(ratios) < estimate.largest_error(0.99)) == pytest.approx(0.99, abs=0.01)


def test_bands_hold_the_true_response_with_their_confidence() -> None:
    """Averages over 8 periods leave 6 free terms: bands of a normal distribution would hold 97.6 %."""
    inside = []
    for seed in range(4):
        random = np.random.default_rng(seed)
        repeated = [np.tile(random.normal(size=(1_000, 2)), (5, 1)) for _ in range(2)]
        parts = [noise_experiment(reference, 100 * axis + seed, noise=0.02) for axis, reference in enumerate(repeated)]
        response = estimate_response(merge(parts)).response
        low, high = response.magnitude_band(0.99)
        true = np.abs(true_response(response.frequency))
        inside.append(((low < true) & (true < high)).ravel())
    assert np.concatenate(inside).mean() == pytest.approx(0.99, abs=0.004)


def test_one_periodic_signal_on_both_axes_at_once_needs_neighbouring_frequencies() -> None:
    """Its lines give one equation for two columns; random phases from line to line give the second."""
    random = np.random.default_rng(1)
    estimate = estimate_response(noise_experiment(random.normal(size=(8_000, 2))))
    assert estimate.response.label.startswith("smoothed over")
    error = np.linalg.norm(estimate.response.response - true_response(estimate.response.frequency), 2, axis=(1, 2))
    assert np.median(error / np.linalg.norm(true_response(estimate.response.frequency), 2, axis=(1, 2))) < 0.1


@pytest.mark.parametrize("both", [[1.0, 1.0], [1.0, 0.0]])
def test_dependent_references_determine_nothing(both: list[float]) -> None:
    same = np.random.default_rng(1).normal(size=(8_000, 1)) * both
    with pytest.raises(IdentificationError, match="excite the axes one after the other"):
        estimate_response(noise_experiment(same))


def test_two_experiments_tell_apart_what_one_cannot() -> None:
    same = np.random.default_rng(1).normal(size=(8_000, 1))
    data = merge([noise_experiment(same * [1.0, 1.0], 1), noise_experiment(same * [1.0, -1.0], 2)])
    estimate = estimate_response(data)
    assert np.median(np.abs(estimate.response.response - true_response(estimate.response.frequency))) < 0.05


@pytest.mark.parametrize("inputs", [3, 8, 10])
def test_bands_hold_terms_enough_for_any_number_of_inputs(inputs: int) -> None:
    process = LinearProcess(inputs, 2)
    estimate = estimate_response(process.data(20_000), open_loop=True)
    assert estimate.free_terms >= 5.9
    error = estimate.response.response - response_of(process.model, estimate.response.frequency).response
    assert np.mean(np.abs(error) ** 2 < 1.5 * estimate.largest_error(0.99) * estimate.variance) > 0.95


def test_bands_of_two_references_stay_as_narrow_as_they_were() -> None:
    estimate = estimate_response(noise_experiment(np.random.default_rng(1).normal(size=(8_000, 2))))
    assert estimate.response.label == "smoothed over 2 Hz, Hann window"


def test_data_too_short_for_so_many_inputs_are_told() -> None:
    inputs = np.random.default_rng(1).normal(size=(600, 300))
    data = IdentificationData.from_arrays(inputs, inputs[:, :1], 1e-3)
    with pytest.raises(IdentificationError, match="600 samples are too few for 300 inputs; record longer"):
        estimate_response(data, open_loop=True)


def test_where_the_reference_has_no_power_nothing_is_claimed() -> None:
    """Noise in u follows from y there: its ratio is minus the inverse of the controller, not the plant."""
    slow = np.random.default_rng(1).normal(size=(8_000, 2))
    for _ in range(4):
        slow = lfilter([0.1], [1.0, -0.9], slow, axis=0)
    estimate = estimate_response(noise_experiment(20.0 * slow, noise=0.5))
    assert estimate.response.frequency[-1] < 150.0
    assert any("coherence is too low" in note for note in estimate.notes)
    assert np.all(estimate.response.coherence > 0.3)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda item: replace(item, reference=None), "no reference"),
        (lambda item: item.window(0, 400), "too short; 512 samples"),
        (lambda item: replace(item, reference=np.zeros((20_000, 2))), "not determined"),
    ],
)
def test_data_without_an_answer_are_refused(data: IdentificationData, change, reason: str) -> None:
    changed = replace(data, experiments=tuple(change(item) for item in data.experiments))
    with pytest.raises(IdentificationError, match=reason):
        estimate_response(changed)


def test_a_wrong_model_differs_where_it_is_wrong(data: IdentificationData, bearing) -> None:
    right, _ = compare_responses(bearing.model, data)
    wrong, _ = compare_responses(replace(bearing.model, b=1.1 * bearing.model.b), data)
    for band in right.bands:
        if band.high <= 300.0:
            assert band.difference < 3.0 * band.deviation and band.within > 70.0
    assert [band.difference for band in wrong.bands if band.high <= 300.0] == pytest.approx([10.0] * 4, abs=1.0)


def test_the_linearised_plant_is_compared_where_it_is_known(data: IdentificationData, bearing) -> None:
    plant, controller = PlantParameters(), ControllerParameters()
    comparison, notes = compare_responses(bearing.model, data, controller, plant=plant)
    discrete = linearize(Plant(plant), controller).discrete
    assert comparison.plant is not None and not any("plant" in note for note in notes)
    assert comparison.plant.response[100] == pytest.approx(discrete.response(comparison.plant.frequency[100:101])[0])
    assert all(np.isfinite(band.plant_difference) for band in comparison.bands)
    assert len(comparison.responses) == 3


def test_a_plant_of_another_rate_is_left_out_and_said_so(data: IdentificationData, bearing) -> None:
    controller = ControllerParameters(sample_rate=20_000.0)
    comparison, notes = compare_responses(bearing.model, data, controller, plant=PlantParameters())
    assert comparison.plant is None and any("the two rates must be equal" in note for note in notes)


@pytest.mark.slow
def test_the_uncertainty_of_the_model_is_allowed_for(bearing, data: IdentificationData) -> None:
    """Identified from few samples, the model differs from a long estimate by more than the estimate's noise alone."""
    short = bearing.experiment(NOISE, force=FORCE, frequency=20.0, duration=0.2)
    model = pem(short.current, short.position, ssarx(short.current, short.position, 1e-4, 6))
    uncertainty = estimate_uncertainty(model, IdentificationData.from_record(short))
    alone, _ = compare_responses(model, data)
    allowed, _ = compare_responses(model, data, uncertainty=uncertainty)
    assert allowed.model.magnitude_deviation is not None
    within = [(one.within, two.within) for one, two in zip(alone.bands, allowed.bands, strict=True) if one.lines > 5]
    assert all(two >= one for one, two in within) and min(two for _, two in within) > 90.0
