"""A drift is found beside hum and unbalance, and begins where it was planted."""

from __future__ import annotations

import numpy as np

from amb_core.regions import Region, classify
from tests.benchmarks.regions.spread import spread
from tests.synthetic_telemetry import draw_constant_line

CASES, SEED = 100, 32


def measure(cases: int = CASES) -> dict[str, object]:
    """How many drifts are found, and how many onsets are within 2 % in frequency."""
    errors = [error for error in spread(onset_error, range(cases)) if error is not None]
    return {
        "cases": cases,
        "seed": SEED,
        "found": len(errors),
        "within_2_percent": sum(bool(abs(error) <= 0.02) for error in errors),
    }


def onset_error(number: int) -> float | None:
    """Relative error of the onset in frequency; None if no drift is found."""
    case = draw_constant_line(np.random.default_rng([SEED, number]), drift=True)
    onset = classify(case.record, frequency=case.frequency).onsets.get(Region.B)
    return None if onset is None else onset.input_frequency / case.frequency[case.onset] - 1.0
