"""Identification under drift of the position sensors: six shapes, two excitations, two bearings, five seeds each."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from amb_core.ground.errors import IdentificationError
from amb_core.identification import identify
from tests.benchmarks.regions.drift_cases import DRIFTS, EXCITATIONS, STEPS, Case, bearing, record, response_of
from tests.benchmarks.regions.spread import spread

SEEDS = 5
BEARINGS = ("flexible", "rigid")


def measure(seeds: int = SEEDS, steps: int = STEPS) -> dict[str, object]:
    """Counts over 120 runs, and the errors of the frequency response relative to those without drift.

    A run is right if the model has the right number of unstable poles and makes a stable loop with the controller.
    The error is the largest from 5 to 1000 Hz, in the spectral norm, relative to the true response at the frequency.
    """
    cases = [Case(*case) for case in itertools.product(BEARINGS, EXCITATIONS, ("", *DRIFTS), range(seeds), (steps,))]
    outcomes = dict(zip(cases, spread(run, cases), strict=True))
    drifting = [case for case in cases if case.drift]
    ratios = {case: outcomes[case][1] / outcomes[replace(case, drift="")][1] for case in drifting}
    worst = max(drifting, key=ratios.__getitem__)
    return {
        "runs": len(drifting),
        "right": sum(outcomes[case][0] for case in drifting),
        "error_ratio": ratios[worst],
        "error_ratio_median": float(np.median(list(ratios.values()))),
        "worst": f"{worst.bearing}, {worst.excitation}, {worst.drift}, seed {worst.seed}",
        "seeds": list(range(seeds)),
    }


def run(case: Case) -> tuple[bool, float]:
    """Whether unstable poles and closed loop are right, and the error of the frequency response."""
    known = bearing(case.bearing)
    try:
        result = identify(record(case), known.order, controller=known.controller)
    except IdentificationError:
        return False, float("inf")
    true = np.abs(np.linalg.eigvals(known.matrices[0])) > 1.0
    right = len(result.model.unstable_poles()) == int(true.sum()) and result.stable
    error = response_of(result.model.a, result.model.b, result.model.c) - known.response
    size = np.linalg.norm(known.response, axis=(1, 2), ord=2)
    return right, float(np.max(np.linalg.norm(error, axis=(1, 2), ord=2) / size))
