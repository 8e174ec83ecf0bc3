"""Slow oscillations from 1 to 120 Hz are found."""

from __future__ import annotations

import numpy as np

from amb_core.regions import Region, classify
from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import draw_slow_line

CASES, SEED = 100, 33


def measure(cases: int = CASES) -> dict[str, object]:
    """How many oscillations are found."""
    return {"cases": cases, "seed": SEED, "found": sum(spread(found, range(cases)))}


def found(number: int) -> bool:
    """Whether region C of a case begins, after its oscillation has set in, less a tenth of a second."""
    case = draw_slow_line(np.random.default_rng([SEED, number]))
    onset = classify(case.record).axis_onsets["y"].get(Region.C)
    return onset is not None and onset.step >= case.onset - 1000
