"""Lightly damped linear modes are no region C."""

from __future__ import annotations

import numpy as np

from amb_core.regions import Region, classify
from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import draw_light_mode

CASES, SEED = 100, 34


def measure(cases: int = CASES) -> dict[str, object]:
    """How many cases have a false C."""
    return {"cases": cases, "seed": SEED, "false_c": sum(spread(oscillates, range(cases)))}


def oscillates(number: int) -> bool:
    """Whether a case is in region C at some time."""
    case = draw_light_mode(np.random.default_rng([SEED, number]))
    return Region.C in classify(case.record).axis_onsets["y"]
