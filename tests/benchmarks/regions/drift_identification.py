"""Identification under drift of the position sensors: six shapes, two excitations, two bearings, five seeds each."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from amb_core.data.experiments.drift import DriftOption
from amb_core.ground.errors import IdentificationError
from amb_core.identification import identify
from tests.benchmarks.regions.drift_cases import DRIFTS, EXCITATIONS, STEPS, Case, bearing, record, response_of
from tests.benchmarks.regions.spread import spread

SEEDS = 5
BEARINGS = ("flexible", "rigid")
UNCURED = ("flexible", "multisine")


def measure(seeds: int = SEEDS, steps: int = STEPS, every: int = 1) -> dict[str, object]:
    """Counts over 120 runs, and the errors of the frequency response relative to those without drift.

    One of `every` pairs of a bearing and an excitation meets each shape of drift, another one with the next shape: with
    4, each bearing, excitation and shape still takes part.

    A run is right if the model has the right number of unstable poles and makes a stable loop with the controller.
    The error is the largest from 5 to 1000 Hz, in the spectral norm, relative to the true response at the frequency.
    The multisine on the plant of order 10 is identified without the cure of drift, too.
    """
    pairs = list(itertools.product(BEARINGS, EXCITATIONS))
    shapes = [
        (*pair, drift)
        for row, pair in enumerate(pairs)
        for place, drift in enumerate(DRIFTS)
        if (row + place) % every == 0
    ]
    drifting = [Case(*shape, seed, steps) for shape in shapes for seed in range(seeds)]
    uncured = [replace(case, cure=False) for case in drifting if (case.bearing, case.excitation) == UNCURED]
    cases = list(dict.fromkeys([*(replace(case, drift="") for case in drifting), *drifting, *uncured]))
    outcomes = dict(zip(cases, spread(run, cases), strict=True))
    ratios = {case: outcomes[case][1] / outcomes[replace(case, drift="")][1] for case in drifting}
    without = [outcomes[case][1] / outcomes[replace(case, drift="", cure=True)][1] for case in uncured]
    worst = max(drifting, key=ratios.__getitem__)
    return {
        "runs": len(drifting),
        "right": sum(outcomes[case][0] for case in drifting),
        "error_ratio": ratios[worst],
        "error_ratio_median": float(np.median(list(ratios.values()))),
        "worst": f"{worst.bearing}, {worst.excitation}, {worst.drift}, seed {worst.seed}",
        "uncured_error_ratio_least": min(without),
        "uncured_error_ratio": max(without),
        "seeds": list(range(seeds)),
    }


def run(case: Case) -> tuple[bool, float]:
    """Whether unstable poles and closed loop are right, and the error of the frequency response."""
    known = bearing(case.bearing)
    try:
        cure: DriftOption = "auto" if case.cure else "none"
        result = identify(record(case), known.order, controller=known.controller, drift=cure)
    except IdentificationError:
        return False, float("inf")
    true = np.abs(np.linalg.eigvals(known.matrices[0])) > 1.0
    right = len(result.model.unstable_poles()) == int(true.sum()) and result.stable
    error = response_of(result.model.a, result.model.b, result.model.c) - known.response
    size = np.linalg.norm(known.response, axis=(1, 2), ord=2)
    return right, float(np.max(np.linalg.norm(error, axis=(1, 2), ord=2) / size))
