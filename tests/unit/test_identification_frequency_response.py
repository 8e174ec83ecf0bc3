"""Frequency responses: values, bands, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import FrequencyResponse, StateSpaceModel, response_of

FREQUENCIES = np.array([1.0, 10.0, 100.0])


def first_order(pole: float = 0.9) -> StateSpaceModel:
    """Two uncoupled first-order lags with a pole, and a direct path from the first input to the second output."""
    zero = np.zeros(2)
    return StateSpaceModel(
        pole * np.eye(2), np.diag([1.0, 2.0]), np.eye(2), np.array([[0.0, 0.0], [0.5, 0.0]]), np.zeros((2, 2)),
        np.eye(2), zero, zero, zero, 1e-3, method="pem",
    )  # fmt: skip


def measured(**settings: object) -> FrequencyResponse:
    response = np.full((3, 2, 2), -2.0 + 0.0j)
    deviations = {"magnitude_deviation": np.full((3, 2, 2), 0.1), "phase_deviation": np.full((3, 2, 2), 0.05)}
    return FrequencyResponse(FREQUENCIES, response, "measured", **(deviations | settings))


@pytest.mark.parametrize("pole", [0.9, 1.1])
def test_a_first_order_lag_has_its_closed_form(pole: float) -> None:
    response = response_of(first_order(pole), FREQUENCIES)
    lag = 1.0 / (np.exp(2j * np.pi * FREQUENCIES * 1e-3) - pole)
    assert response.response[:, 0, 0] == pytest.approx(lag)
    assert response.response[:, 1, 1] == pytest.approx(2.0 * lag)
    assert response.response[:, 1, 0] == pytest.approx(0.5)
    assert np.all(response.response[:, 0, 1] == 0.0)
    assert response.label == "pem, order 2"
    assert response.magnitude_band() is None
    assert response.phase_band() is None


def test_many_frequencies_give_what_each_gives() -> None:
    many = np.linspace(0.0, 500.0, 60_001)
    at = 43_210
    all_at_once = response_of(first_order(), many)
    assert all_at_once.response[at] == pytest.approx(response_of(first_order(), many[at : at + 1]).response[0])


def test_bands_hold_their_share_of_a_normal_distribution() -> None:
    low, high = measured().magnitude_band(0.99)
    assert np.log(high / 2.0) == pytest.approx(2.5758 * 0.05, rel=1e-4)
    assert low * high == pytest.approx(4.0)
    low, high = measured().phase_band(0.95)
    assert high - np.pi == pytest.approx(1.95996 * 0.05, rel=1e-4)
    assert high - low == pytest.approx(2.0 * 1.95996 * 0.05, rel=1e-4)


def test_bands_of_few_terms_hold_their_share_of_students_distribution() -> None:
    few, many = measured(free_terms=3.0), measured(free_terms=1e9)
    low, high = few.magnitude_band(0.99)
    assert np.log(high / 2.0) == pytest.approx(3.7074 * 0.05, rel=1e-4)  # 6 degrees of freedom
    assert np.log(2.0 / low) == pytest.approx(3.7074 * 0.05, rel=1e-4)
    assert few.phase_band(0.95)[1] - np.pi == pytest.approx(2.4469 * 0.05, rel=1e-4)
    assert many.half_width(0.99) == pytest.approx(measured().half_width(0.99))


def test_an_unknown_response_has_wide_but_harmless_bands() -> None:
    unknown = measured(magnitude_deviation=np.full((3, 2, 2), 1e9), phase_deviation=np.full((3, 2, 2), 1e9))
    low, high = unknown.magnitude_band()
    assert np.all(low == 0.0)
    assert np.all(high == np.inf)
    low, high = unknown.phase_band()
    assert high - low == pytest.approx(2.0 * np.pi)


def test_the_phase_is_continuous() -> None:
    angles = -np.arange(3) * 3.0
    turning = replace(measured(), response=np.exp(1j * angles)[:, np.newaxis, np.newaxis] * np.ones((3, 2, 2)))
    assert turning.phase[:, 1, 0] == pytest.approx(angles)


def test_arrays_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        measured().response[0, 0, 0] = 1.0


@pytest.mark.parametrize(
    ("frequencies", "message"),
    [
        ([], "row of finite numbers"),
        ([1.0, np.nan], "row of finite numbers"),
        ([10.0, 1.0], "must ascend"),
        ([-1.0, 1.0], "must ascend, from 0 Hz"),
        ([1.0, 501.0], "501 Hz is not allowed; allowed: 0 to 500 Hz"),
    ],
)
def test_frequencies_that_make_no_sense_are_refused(frequencies: list[float], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        response_of(first_order(), frequencies)


def test_a_pole_at_a_frequency_is_told() -> None:
    with pytest.raises(IdentificationError, match="the model has a pole at 0 Hz"):
        response_of(first_order(1.0), [0.0, 1.0])


def test_parts_that_do_not_fit_are_refused() -> None:
    with pytest.raises(IdentificationError, match="'coherence' has shape"):
        measured(coherence=np.ones(3))
    with pytest.raises(IdentificationError, match="'magnitude_deviation' holds values that are not finite"):
        measured(magnitude_deviation=np.full((3, 2, 2), np.nan))
    with pytest.raises(IdentificationError, match="2 inputs and 2 outputs need as many units"):
        measured(input_units=("A",))
    with pytest.raises(IdentificationError, match=r"a confidence of 1\.0 is not allowed"):
        measured().magnitude_band(1.0)


@pytest.mark.parametrize("terms", [0.0, np.nan, np.inf])
def test_no_positive_number_of_free_terms_is_refused(terms: float) -> None:
    with pytest.raises(IdentificationError, match=r"'free_terms' = .* is not allowed; allowed: more than 0, finite"):
        measured(free_terms=terms)
