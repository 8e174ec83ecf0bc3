"""Planted onsets of B, C and D are found, and none where there is none: the cases of test_regions_onsets."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import FAMILIES, PLANTED, draw
from tests.unit.test_regions_onsets import judge

CASES, SEED = 200, 7


def measure(cases: int = CASES) -> dict[str, object]:
    """How many planted onsets are found within 2 % in frequency, and how many are false."""
    outcomes = spread(outcome, range(cases))
    return {
        "cases": cases,
        "seed": SEED,
        "planted": sum(family in PLANTED for family, _ in outcomes),
        "found": sum(judged == "found" for _, judged in outcomes),
        "false": sum(judged.startswith("false") for _, judged in outcomes),
    }


def outcome(number: int) -> tuple[str, str]:
    """Family of a case, and what the classifier makes of it."""
    case = draw(FAMILIES[number % len(FAMILIES)], np.random.default_rng([SEED, number]))
    return case.family, judge(case)
