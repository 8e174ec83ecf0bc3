"""Frequency responses from periodic references: averaged over whole periods, right at their lines even from few."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.data.experiments import merge
from amb_core.excitation.seeded import Multisine
from amb_core.identification import IdentificationData
from amb_core.identification.nonparametric import NonparametricEstimate, estimate_response

SAMPLE_TIME = 1e-3
PERIOD = 2_000
GAIN = np.array([[1.5, 0.4], [-0.3, 2.0]])
FEEDBACK = 0.5
POLE = 0.6


def experiment(reference: np.ndarray, noise: float, seed: int = 0) -> IdentificationData:
    """A plant y = GAIN lowpass(u) + v under the feedback u = r - y / 2; it starts at rest."""
    random = np.random.default_rng(seed)
    v = noise * random.normal(size=reference.shape)
    u, y, state = np.empty_like(reference), np.empty_like(reference), np.zeros(2)
    for step, wanted in enumerate(reference):
        y[step] = GAIN @ state + v[step]
        u[step] = wanted - FEEDBACK * y[step]
        state = POLE * state + (1.0 - POLE) * u[step]
    return IdentificationData.from_arrays(u, y, SAMPLE_TIME, reference=reference)


def multisine(periods: int, seed: int = 0, **options: object) -> np.ndarray:
    duration = periods * PERIOD * SAMPLE_TIME
    signal = Multisine(
        amplitude=1e-4, duration=duration, frequency_start=5.0, frequency_end=300.0, periods=periods, seed=seed,
        phasing="optimised", **options,
    )  # fmt: skip
    return np.stack(
        [signal.sampler(periods * PERIOD, 1.0 / SAMPLE_TIME, axis)(0, periods * PERIOD) for axis in (0, 1)], 1
    )


def true_response(frequency: np.ndarray) -> np.ndarray:
    delay = np.exp(-2j * np.pi * frequency * SAMPLE_TIME)[:, np.newaxis, np.newaxis]
    return GAIN * (1.0 - POLE) * delay / (1.0 - POLE * delay)


def relative_errors(estimate: NonparametricEstimate) -> np.ndarray:
    true = true_response(estimate.response.frequency)
    return np.linalg.norm(estimate.response.response - true, 2, axis=(1, 2)) / np.linalg.norm(true, 2, axis=(1, 2))


@pytest.mark.parametrize("interleaved", [True, False])
def test_three_periods_give_the_response_at_their_lines(interleaved: bool) -> None:
    """The excitation of the tutorial's validation: odd lines of both axes at once, one of four left out."""
    estimate = estimate_response(experiment(multisine(3, odd=True, interleaved=interleaved), noise=1e-8))
    lines = estimate.response.frequency * PERIOD * SAMPLE_TIME
    assert estimate.response.label.startswith("average of 2 periods of 2 s")
    assert lines == pytest.approx(np.round(lines)) and np.all(np.round(lines) % 2 == 1)
    assert len(lines) > 200
    assert relative_errors(estimate).max() < 0.01


@pytest.mark.parametrize("interleaved", [True, False])
def test_errors_of_few_periods_are_those_that_the_noise_allows(interleaved: bool) -> None:
    """|error|^2 / variance of thousands of values, against the quantiles of its F distribution."""
    ratios = []
    for seed in range(4):
        estimate = estimate_response(experiment(multisine(3, seed, odd=True, interleaved=interleaved), 2e-6, seed))
        error = estimate.response.response - true_response(estimate.response.frequency)
        ratios.append(np.abs(error) ** 2 / estimate.variance)
    together = np.concatenate(ratios)
    assert np.median(together) == pytest.approx(estimate.largest_error(0.5), rel=0.15)
    assert np.mean(together < estimate.largest_error(0.99)) == pytest.approx(0.99, abs=0.01)


def test_two_experiments_of_three_periods_need_no_neighbouring_lines() -> None:
    """Four settled periods of two signals determine each line by itself."""
    data = merge([experiment(multisine(3, seed), 2e-6, seed) for seed in (1, 2)])
    estimate = estimate_response(data)
    assert estimate.response.label == "average of 4 periods of 2 s"
    error = estimate.response.response - true_response(estimate.response.frequency)
    ratio = np.abs(error) ** 2 / estimate.variance
    assert np.median(ratio) == pytest.approx(estimate.largest_error(0.5), rel=0.25)
    assert np.mean(ratio < estimate.largest_error(0.99)) > 0.97


def test_a_few_periods_within_a_long_noise_do_not_make_it_periodic() -> None:
    random = np.random.default_rng(3)
    reference = 1e-4 * random.normal(size=(20_000, 2))
    reference[8_000:9_000] = np.tile(reference[8_000:8_250], (4, 1))
    assert estimate_response(experiment(reference, 1e-6)).response.label.startswith("smoothed over")


def test_periods_after_a_rest_and_about_an_offset_are_found() -> None:
    moving = multisine(3, interleaved=True)
    estimate = estimate_response(experiment(7e-4 + np.vstack([np.zeros((700, 2)), moving, np.zeros((900, 2))]), 1e-8))
    assert estimate.response.label.startswith("average of 2 periods of 2 s")
    assert relative_errors(estimate).max() < 0.01
