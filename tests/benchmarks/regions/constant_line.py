"""Hum and unbalance that are there from the start are neither region B nor region C."""

from __future__ import annotations

import numpy as np

from amb_core.regions import Region, classify
from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import draw_constant_line

CASES, SEED = 100, 31


def measure(cases: int = CASES) -> dict[str, object]:
    """How many cases have a false B or C."""
    onsets = spread(regions, range(cases))
    return {
        "cases": cases,
        "seed": SEED,
        "false_b": sum(Region.B in one for one in onsets),
        "false_c": sum(Region.C in one for one in onsets),
    }


def regions(number: int) -> set[Region]:
    """The regions of a case, on either axis."""
    case = draw_constant_line(np.random.default_rng([SEED, number]), drift=False)
    return {region for onsets in classify(case.record).axis_onsets.values() for region in onsets}
