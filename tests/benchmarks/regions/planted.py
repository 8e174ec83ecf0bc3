"""Planted onsets of B, C and D are found, and none where there is none: the cases of test_regions_onsets."""

from __future__ import annotations

import numpy as np

from amb_core.regions import classify
from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import CLEARANCE, FAMILIES, PLANTED, draw
from tests.unit.test_regions_onsets import error_of, judge

CASES, SEED = 200, 7


def measure(cases: int = CASES) -> dict[str, object]:
    """How many planted onsets are found within 2 % in frequency, with which errors, and how many are false."""
    outcomes = spread(outcome, range(cases))
    errors = [100.0 * error for _, judged, error in outcomes if judged == "found"]
    return {
        "cases": cases,
        "seed": SEED,
        "planted": sum(family in PLANTED for family, _, _ in outcomes),
        "found": sum(judged == "found" for _, judged, _ in outcomes),
        "false": sum(judged.startswith("false") for _, judged, _ in outcomes),
        "error_percent": float(np.median(errors)) if errors else None,
        "error_percent_largest": max(errors, default=None),
    }


def outcome(number: int) -> tuple[str, str, float]:
    """Family of a case, what the classifier makes of it, and the relative error of a frequency that it found."""
    case = draw(FAMILIES[number % len(FAMILIES)], np.random.default_rng([SEED, number]))
    judged = judge(case)
    if judged != "found":
        return case.family, judged, 0.0
    onset = classify(case.record, clearance=CLEARANCE).onsets[PLANTED[case.family]]
    return case.family, judged, abs(error_of(case, onset))
