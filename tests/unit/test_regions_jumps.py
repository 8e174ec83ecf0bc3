"""A jump of the bias counts as drift by its height, and begins where it is; a drift by its change over the test."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from amb_core.loop.records import LoopRecord
from amb_core.regions import Region, RegionParameters, classify
from amb_core.regions.trend import TrendTest, jump, kink

RATE = 10_000.0
INTERVAL = 0.01
PARAMETERS = RegionParameters()
THRESHOLD = PARAMETERS.drift_threshold
BELOW, ABOVE = (0.5, 0.67, 0.9), (1.1, 1.5, 4.0)  # heights over the threshold


def first_drift(points: NDArray[np.float64]) -> float | None:
    """Index at which the first drift of some bias points (m) begins, by the trend test of the classifier."""
    test = TrendTest(24, INTERVAL, PARAMETERS.false_alarm_rate / 3600.0)
    for latest, point in enumerate(points):
        test.add(point)
        drifting = test.drifting(THRESHOLD)
        if drifting is not None:
            return latest - test.beginning(drifting)[0]
    return None


def bias_points(height: float, at: float, noise: float) -> NDArray[np.float64]:
    """Bias points of 20 s (m), each a mean over an interval around its index, with a jump at an index with fraction."""
    share = np.clip(np.arange(2_000) + 0.5 - at, 0.0, 1.0)
    return -50e-6 + height * share + np.random.default_rng(round(at)).normal(scale=noise, size=len(share))


JUMPS = pytest.mark.parametrize(
    ("noise", "at", "sign"),
    [(0.01e-6, 300.0, 1.0), (0.1e-6, 412.3, -1.0), (0.1e-6, 905.8, 1.0), (0.3e-6, 1111.5, -1.0), (0.3e-6, 700.0, 1.0)],
)


@JUMPS
@pytest.mark.parametrize("ratio", BELOW)
def test_a_jump_below_the_threshold_is_no_drift(ratio: float, noise: float, at: float, sign: float) -> None:
    assert first_drift(bias_points(sign * ratio * THRESHOLD, at, noise)) is None


@JUMPS
@pytest.mark.parametrize("ratio", ABOVE)
def test_a_jump_above_the_threshold_is_drift_from_its_step_onwards(
    ratio: float, noise: float, at: float, sign: float
) -> None:
    assert first_drift(bias_points(sign * ratio * THRESHOLD, at, noise)) == pytest.approx(at, abs=1.0)


@pytest.mark.parametrize("slope", [2e-6, 20e-6, 200e-6])
def test_a_drift_begins_at_its_kink(slope: float) -> None:
    points = slope * INTERVAL * np.maximum(np.arange(2_000) - 700.0, 0.0)
    noise = np.random.default_rng(1).normal(scale=0.05e-6, size=len(points))
    assert first_drift(points + noise) == pytest.approx(700.0, abs=3.0 + 0.1e-6 / (slope * INTERVAL))


def test_two_jumps_add_up() -> None:
    both = bias_points(0.67 * THRESHOLD, 600.0, 0.05e-6) + bias_points(0.67 * THRESHOLD, 640.0, 0.0)
    assert first_drift(both) is not None


def test_a_jump_is_found_where_it_is_with_its_height() -> None:
    points = np.concatenate([np.full(11, -50e-6), [-50.75e-6], np.full(12, -53e-6)])
    index, height, left = jump(points)
    assert (index, height) == (pytest.approx(11.25), pytest.approx(-3e-6))
    assert left < 1e-3 * kink(points)[1]


# -- in telemetry


def telemetry(height: float, at: float, noise: float, excited: bool) -> LoopRecord:
    """Telemetry of 3.5 s at 50 um below the centre, with a jump on y that a loop of 60 Hz settles to."""
    time = np.arange(35_000) / RATE
    natural = 2.0 * np.pi * 60.0
    b, a, _ = cont2discrete(([natural**2], [1.0, natural, natural**2]), 1.0 / RATE)
    random = np.random.default_rng([round(RATE * at), excited])
    reference, position = np.zeros((len(time), 2)), random.normal(scale=noise, size=(len(time), 2))
    if excited:
        reference[5_000:, 1] = 15e-6 * np.sin(2.0 * np.pi * 700.0 * time[:-5_000])
    position[:, 1] += -50e-6 + 0.15 * reference[:, 1] + lfilter(b.ravel(), a, np.where(time >= at, height, 0.0))
    return LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position))


@pytest.mark.parametrize("excited", [False, True])
@pytest.mark.parametrize(
    ("ratio", "at", "noise"),
    [(0.5, 2.0, 0.1e-6), (-0.67, 2.003, 0.02e-6), (0.67, 1.5, 0.5e-6), (0.9, 2.106, 0.1e-6), (-0.9, 1.807, 0.5e-6)],
)
def test_a_position_that_jumps_below_the_threshold_stays_in_region_a(
    ratio: float, at: float, noise: float, excited: bool
) -> None:
    assert classify(telemetry(ratio * THRESHOLD, at, noise, excited)).onsets == {}


@pytest.mark.parametrize("excited", [False, True])
@pytest.mark.parametrize(
    ("ratio", "at", "noise"), [(1.1, 2.0, 0.1e-6), (-1.1, 2.003, 0.5e-6), (-1.5, 1.507, 0.02e-6), (10.0, 2.106, 0.1e-6)]
)
def test_a_position_that_jumps_above_the_threshold_is_in_region_b_since_then(
    ratio: float, at: float, noise: float, excited: bool
) -> None:
    onsets = classify(telemetry(ratio * THRESHOLD, at, noise, excited)).onsets
    assert set(onsets) == {Region.B}
    assert onsets[Region.B].time == pytest.approx(at, abs=0.01)
    assert math.isnan(onsets[Region.B].input_frequency) is not excited
