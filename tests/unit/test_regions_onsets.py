"""Onsets that are planted in synthetic telemetry are found, and none where there is none.

A case is a sweep (or another excitation) through a linear loop with random natural frequency and damping, with white
sensor noise and white force noise, to which at most one thing is added: a drift of the bias, a slow oscillation,
contact with the backup bearing, or a harmonic of the input that folds at the sample rate.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.regions import Onset, Region, classify
from amb_core.regions.slow_signal import variance_change
from amb_core.regions.trend import TrendTest, kink
from tests import synthetic_telemetry as synthetic
from tests.synthetic_telemetry import CLEARANCE, FAMILIES, Case, draw

PLANTED = synthetic.PLANTED


def judge(case: Case) -> str:
    """What the classifier makes of a case: `found`, `missed`, `false B`, `false C` or `quiet`."""
    onsets = classify(case.record, clearance=CLEARANCE).onsets
    planted = PLANTED.get(case.family)
    if planted is not Region.D:
        for region in (Region.B, Region.C):
            if region in onsets and region != planted:
                return f"false {region.name}"
    if planted is None:
        return "quiet"
    if planted not in onsets:
        return "missed"
    error = error_of(case, onsets[planted])
    return "found" if abs(error) <= 0.02 else f"off by {error:+.1%} at {case.frequency[case.onset]:.0f} Hz"


def error_of(case: Case, onset: Onset) -> float:
    """Relative error of the frequency at which the planted region was found."""
    return float(onset.input_frequency / case.frequency[case.onset] - 1.0)


def outcomes(seed: int, cases: int) -> Counter[tuple[str, str]]:
    """How often each family of cases came to each outcome."""
    counts: Counter[tuple[str, str]] = Counter()
    for number in range(cases):
        case = draw(FAMILIES[number % len(FAMILIES)], np.random.default_rng([seed, number]))
        counts[case.family, judge(case)] += 1
    return counts


def assert_told_apart(counts: Counter[tuple[str, str]]) -> None:
    """At least 95 % of the planted onsets are found within 2 % in frequency; at most 2 % of the rest have one."""
    planted = {key: count for key, count in counts.items() if key[0] in PLANTED}
    hits = sum(count for key, count in planted.items() if key[1] == "found")
    assert hits >= 0.95 * sum(planted.values()), counts
    false = sum(count for key, count in counts.items() if key[1].startswith("false"))
    assert false <= 0.02 * sum(counts.values()), counts


@pytest.mark.slow
def test_planted_onsets_are_found() -> None:
    assert_told_apart(outcomes(seed=1, cases=12))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_planted_onsets_are_found_in_200_cases() -> None:
    assert_told_apart(outcomes(seed=7, cases=200))


@pytest.mark.parametrize(
    ("correlation", "rate", "factor"),
    [(0.0, 1.0, 0.25), (0.3, 1.0, 1.0), (0.0, 1.0 / 60.0, 0.5), (0.3, 1.0 / 60.0, 2.5)],
)
def test_noise_raises_as_many_alarms_as_told(correlation: float, rate: float, factor: float) -> None:
    """As many as docs/explanation/regions.md states, with room for chance; correlated noise raises more of them."""
    noise = lfilter([1.0], [1.0, -correlation], np.random.default_rng(5).normal(scale=1e-6, size=60_000))
    interval = 0.01
    test = TrendTest(24, interval, rate)
    alarmed = np.array([test.add(point).significance >= 1.0 for point in noise])
    alarms = np.count_nonzero(alarmed[1:] & ~alarmed[:-1])
    assert alarms <= factor * rate * interval * len(noise)


def test_a_kink_is_found_where_it_is() -> None:
    points = 1e-6 * np.concatenate([np.full(60, 3.0), 3.0 - 0.5 * np.arange(1, 31)])
    assert kink(points)[0] == 59


def test_a_change_of_variance_is_found_where_it_is() -> None:
    noise = np.random.default_rng(2).normal(size=200) * np.where(np.arange(200) < 130, 1.0, 6.0)
    assert variance_change(noise) == pytest.approx(130, abs=2)
