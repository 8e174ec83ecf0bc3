"""Verdicts on the rig follow from what it did: other ends, drifts, bursts and resonances, other verdicts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.regions import Classification, Judged
from amb_paper.studies.sweep_rig import (
    CONFIGURED,
    Resonance,
    bias,
    judge_drift,
    judge_resonances,
    judge_slow,
    judge_survival,
    resonance,
    slow_component,
)
from amb_paper.sweeps import SweptBearing

ALL_JUDGED = Judged({}, {}, 0.7)
STEPS = 40_000
TIME = np.arange(STEPS) * 1e-4
FREQUENCY = np.linspace(100.0, 4000.0, STEPS)


def swept(y: np.ndarray) -> SweptBearing:
    """A sweep with a given response on y (m)."""
    position = np.column_stack([np.zeros(STEPS), y])
    record = LoopRecord(0, 1e-4, np.zeros((STEPS, 2)), position, np.zeros((STEPS, 2)))
    return SweptBearing(
        Plant(), ControllerParameters(), record, FREQUENCY, Classification([], {}, {"x": {}, "y": {}}, ALL_JUDGED)
    )


@pytest.mark.parametrize(
    ("ends", "verdict"),
    [
        ({CONFIGURED: None, "other": 45.0}, "agrees"),
        ({CONFIGURED: 39.0, "other": None}, "agrees in part"),
        ({CONFIGURED: 39.0, "other": 45.0}, "does not agree"),
    ],
)
def test_the_rig_survives_as_configured_or_with_other_options(ends: dict[str, float | None], verdict: str) -> None:
    assert judge_survival(ends).verdict == verdict


@pytest.mark.parametrize(
    ("span", "reported", "verdict"),
    [(6e-6, True, "agrees"), (6e-6, False, "agrees in part"), (1e-6, True, "does not agree")],
)
def test_a_drift_is_more_than_the_threshold(span: float, reported: bool, verdict: str) -> None:
    claim = judge_drift(np.array([-70e-6, -70e-6 + span]), reported)
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


@pytest.mark.parametrize(
    ("amplitude", "reported", "verdict"),
    [(9e-6, True, "agrees"), (9e-6, False, "agrees in part"), (0.1e-6, False, "does not agree")],
)
def test_slow_motion_that_is_beating_agrees_in_part(amplitude: float, reported: bool, verdict: str) -> None:
    claim = judge_slow(amplitude, 3333.0, reported=reported)
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


@pytest.mark.parametrize(
    ("reach", "ratio", "verdict"),
    [(150e-6, 5.0, "agrees"), (150e-6, 1.2, "agrees in part"), (50e-6, math.nan, "does not agree")],
)
def test_resonances_of_the_rigid_and_of_the_flexible_rotor_must_show(reach: float, ratio: float, verdict: str) -> None:
    claim = judge_resonances(reach, {2400.0: Resonance(10e-6, ratio)})
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


def test_a_resonance_that_is_small_beside_the_largest_movement_is_not_easily_seen() -> None:
    claim = judge_resonances(168e-6, {1526.0: Resonance(2.5e-6, 4.7)})
    assert claim.verdict == "agrees in part"
    assert "2.5 µm at 1526 Hz, 4.7 times" in claim.finding


def test_the_bias_is_the_mean_over_half_a_second() -> None:
    means = bias(swept(-70e-6 + 5e-6 * TIME / TIME[-1] + 3e-6 * np.sin(2.0 * np.pi * 500.0 * TIME)))
    assert len(means) == 7
    assert np.ptp(means) == pytest.approx(5e-6 * 6 * 0.5 / TIME[-1], rel=1e-3)


def test_a_slow_burst_is_found_where_it_is() -> None:
    burst = 8e-6 * np.sin(2.0 * np.pi * 20.0 * TIME) * np.exp(-(((FREQUENCY - 3000.0) / 300.0) ** 2))
    amplitude, frequency = slow_component(swept(burst + 3e-6 * np.sin(2.0 * np.pi * 500.0 * TIME)))
    assert amplitude == pytest.approx(8e-6, rel=0.1)
    assert frequency == pytest.approx(3000.0, abs=50.0)


def test_a_resonance_stands_out_of_what_is_beside_it() -> None:
    size = 1.0 + 4.0 / (1.0 + ((FREQUENCY - 2000.0) / 20.0) ** 2)
    response = 1e-6 * size * np.sin(2.0 * np.pi * 700.0 * TIME)
    assert resonance(swept(response), 2000.0).prominence == pytest.approx(4.5, rel=0.15)
    assert resonance(swept(response), 2000.0).amplitude == pytest.approx(5e-6, rel=0.1)
    assert resonance(swept(response), 1000.0).prominence == pytest.approx(1.0, rel=0.05)
    assert math.isnan(resonance(swept(response), 4900.0).prominence)
