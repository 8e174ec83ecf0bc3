"""Tests of residuals: white and independent ones pass as often as promised, others are found and measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.ground.errors import IdentificationError
from amb_core.identification.validation import check_residuals

WHITE = np.random.default_rng(5).normal(size=(500, 1))


class TestResiduals:
    """Tests of residuals alone, on signals whose nature is known."""

    @pytest.fixture
    def random(self) -> np.random.Generator:
        """A generator of each test's own: what a test draws does not depend on the tests that ran before it."""
        return np.random.default_rng(5)

    def test_one_of_a_hundred_white_residuals_fails_each_test(self, random: np.random.Generator) -> None:
        """Of 200 runs 2 are expected to fail; more than 8 have a probability of 2e-4."""
        fails = np.zeros(2)
        for _ in range(200):
            white = random.normal(size=(400, 2)) @ [[1.0, 0.6], [0.0, 1.0]]
            residuals = check_residuals([white], [random.normal(size=(400, 2))], lags=5)
            fails += not residuals.whiteness.passed, not residuals.independence.passed
        assert fails.max() <= 8

    def test_feedback_does_not_count_as_dependence(self, random: np.random.Generator) -> None:
        """A controller answers the residual of the same and of earlier samples, never of later ones."""
        white = random.normal(size=(20_000, 1))
        feedback = lfilter([0.9, 0.3], [1.0, -0.5], white, axis=0) + 0.1 * random.normal(size=white.shape)
        residuals = check_residuals([white], [feedback])
        assert residuals.independence.passed and residuals.whiteness.passed
        assert np.abs(residuals.cross_correlation[25, 0, 0]) > 0.5  # lag 0 is reported, not tested

    def test_what_past_inputs_explain_is_found_and_measured(self, random: np.random.Generator) -> None:
        u, white = random.normal(size=(2, 20_000, 1))
        residual = white + 0.2 * np.vstack([np.zeros((3, 1)), u[:-3]])
        residuals = check_residuals([residual], [u])
        past = np.column_stack([np.concatenate([np.zeros(lag), u[:-lag, 0]]) for lag in range(1, 26)])
        unexplained = residual - past @ np.linalg.lstsq(past, residual, rcond=None)[0]
        assert not residuals.independence.passed
        # Of the samples drawn, not of their distribution: by a seed the one differs from 0.04 / 1.04 by 15 %.
        assert residuals.independence.unexplained == pytest.approx(1.0 - unexplained.var() / residual.var(), rel=0.03)
        assert residuals.cross_correlation[25 + 3, 0, 0] > residuals.band

    def test_colour_is_found_and_measured(self, random: np.random.Generator) -> None:
        coloured = lfilter([1.0], [1.0, -0.3], random.normal(size=(20_000, 1)), axis=0)
        residuals = check_residuals([coloured], [random.normal(size=(20_000, 1))])
        assert not residuals.whiteness.passed and residuals.independence.passed
        assert residuals.whiteness.unexplained == pytest.approx(0.09, rel=0.15)

    def test_borders_between_experiments_are_not_crossed(self, random: np.random.Generator) -> None:
        """The second experiment starts with the end of the first: across the border they are alike."""
        white = random.normal(size=(600, 1))
        residuals = check_residuals([white[:300], white[280:]], [white[:300] * 0 + random.normal(size=(300, 1)),
                                                           random.normal(size=(320, 1))], lags=5)  # fmt: skip
        assert residuals.samples == 620 and residuals.whiteness.passed

    def test_an_estimated_model_is_allowed_its_uncertain_parameters(self, random: np.random.Generator) -> None:
        signals = ([random.normal(size=(1_000, 2))], [random.normal(size=(1_000, 2))])
        exact = check_residuals(*signals).whiteness
        estimated = check_residuals(*signals, parameters=60, estimation_samples=1_000).whiteness
        endless = check_residuals(*signals, parameters=60, estimation_samples=10**9).whiteness
        assert exact.limit == pytest.approx(149.4, abs=0.1)  # chi^2 of 100 degrees of freedom at 99.9 %
        assert estimated.limit > exact.limit + 60 and endless.limit == pytest.approx(exact.limit, rel=1e-4)

    def test_inputs_that_follow_from_each_other_count_once(self, random: np.random.Generator) -> None:
        u = random.normal(size=(1_000, 1))
        residuals = check_residuals([random.normal(size=(1_000, 1))], [np.hstack([u, 2.0 * u])], lags=10)
        assert residuals.independence.degrees == 10

    @pytest.mark.parametrize(
        ("residuals", "inputs", "reason"),
        [
            (np.ones((100, 1)), np.ones((100, 1)), "100 samples are too few to test residuals over 25 lags"),
            (np.ones((500, 1)), WHITE, "residual 1 is constant"),
            (WHITE, np.ones((500, 1)), "input 1 is constant"),
            (WHITE * [1.0, 1.0], WHITE[::-1], "multiples of one another"),
        ],
    )
    def test_signals_that_tell_nothing_are_refused(
        self, residuals: np.ndarray, inputs: np.ndarray, reason: str
    ) -> None:
        with pytest.raises(IdentificationError, match=reason):
            check_residuals([residuals], [inputs])
