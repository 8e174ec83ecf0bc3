"""The part `distortion`: whether what a designed excitation is certified for holds with other realisations.

A multisine is designed for each of many random bearings. The certificate is false where the designed signal, simulated
once more, deviates from the linear response by more than the limit, or where the distortion of new random-phase
multisines of its band and power, four for each of two seeds, is above it.

    python -m tests.benchmarks.verdicts.distortion --seed 14
"""

from __future__ import annotations

from collections.abc import Callable

from amb_core.designs.excitation import Limits, TrialBench, design_excitation, use_of_trial
from amb_core.designs.excitation.multisine_distortion import distortion_settings
from amb_core.ground.errors import ExcitationError, SpectrumError
from amb_core.regions.distortion import simulate_distortion
from tests.benchmarks.regions.design import SEED, TOLERANCE, Case, draw
from tests.benchmarks.verdicts.alone import start_alone

BEARINGS, DURATION = 100, 1.0  # s
NEW_SEEDS = (501, 502)


def run(quick: bool, progress: Callable[[int, int], None], seed: int = SEED) -> dict[str, int]:
    """How many certificates are false."""
    cases = draw(1 if quick else BEARINGS, seed)
    designed = false = 0
    for number, case in enumerate(cases):
        held = holds(case, 0.5 if quick else DURATION, NEW_SEEDS[:1] if quick else NEW_SEEDS)
        designed += held is not None
        false += held is False
        progress(number + 1, len(cases))
    return {"bearings": designed, "false": false}


def holds(case: Case, duration: float, new_seeds: tuple[int, ...]) -> bool | None:
    """Whether the certificate of a bearing is true; None where no amplitude is certified."""
    fields = {"duration": duration, "frequency_start": 10.0, "frequency_end": case.frequency_end}
    limits = Limits()
    try:
        design = design_excitation("multisine", fields, None, case.controller, case.plant, tolerance=TOLERANCE)
    except ExcitationError:
        return None
    bench = TrialBench(case.plant, case.controller)
    again = use_of_trial(bench.run(design.signal), limits, bench.regions.drift_threshold)
    if again.share > 1.0:
        return False
    settings = distortion_settings(design.signal, limits.seeds)
    for seed in new_seeds:
        try:
            other = simulate_distortion(case.plant, case.controller, settings.model_copy(update={"seed": seed}))
        except SpectrumError:  # the rotor delevitates
            return False
        if other.ratio.max() > limits.distortion_limit:
            return False
    return True


if __name__ == "__main__":
    start_alone(run)
