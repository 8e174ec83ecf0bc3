"""Lightly damped linear modes are no region C."""

from __future__ import annotations

import numpy as np
from spread import spread

from amb_core.regions import Region, classify
from tests.synthetic_telemetry import draw_light_mode

CASES, SEED = 100, 34


def measure() -> dict[str, object]:
    """How many cases have a false C."""
    return {"cases": CASES, "seed": SEED, "false_c": sum(spread(oscillates, range(CASES)))}


def oscillates(number: int) -> bool:
    """Whether a case is in region C at some time."""
    case = draw_light_mode(np.random.default_rng([SEED, number]))
    return Region.C in classify(case.record).axis_onsets["y"]
