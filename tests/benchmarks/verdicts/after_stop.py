"""A slow oscillation that begins 0.3 to 2 s after an excitation has stopped is named region C.

Random linear loops of one to four axes are excited, stop, and begin to oscillate while the monitor still waits for the
loop to settle. `quiet` are the same loops with a line that was there before the excitation, or none: no C may be named.

    python -m tests.benchmarks.verdicts.after_stop --seed 2
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter

from amb_core.excitation import excitation_from_request, generate
from amb_core.loop.records import LoopRecord, axis_names
from amb_core.regions import Region, classify
from amb_core.regions.layout import layout_without_machine
from tests.benchmarks.verdicts.alone import start_alone

CASES, SEED = 100, 41
RATE = 10_000.0
EXCITATIONS: tuple[dict[str, object], ...] = (
    {"kind": "sweep", "amplitude": 20e-6, "frequency_start": 10.0, "frequency_end": 1_000.0},
    {"kind": "square", "amplitude": 20e-6},
    {"kind": "multisine", "amplitude": 20e-6, "frequency_start": 5.0, "frequency_end": 2_000.0},
    {"kind": "prbs", "amplitude": 20e-6},
    {"kind": "white_noise", "amplitude": 10e-6},
)


@dataclass(frozen=True)
class AfterStop:
    """A record, the axis that oscillates, and the step of the onset; no onset where the line was there before."""

    record: LoopRecord
    axis: str
    onset: int | None


def run(quick: bool, progress: Callable[[int, int], None], seed: int = SEED) -> dict[str, int]:
    """How many onsets are named."""
    cases = 4 if quick else CASES
    count = 0
    for number in range(cases):
        count += named(draw(np.random.default_rng([seed, number])))
        progress(number + 1, cases)
    return {"cases": cases, "named": count}


def named(case: AfterStop) -> bool:
    """Whether C is named after an onset, on its axis, and remains; without an onset, whether any C is named."""
    timeline = classify(case.record)
    if case.onset is None:
        return any(Region.C in onsets for onsets in timeline.axis_onsets.values())
    onset = timeline.axis_onsets[case.axis].get(Region.C)
    return onset is not None and onset.step >= case.onset - 1_000 and timeline.states[-1].axis(case.axis).region >= 2


def draw(random: np.random.Generator, quiet: bool = False) -> AfterStop:
    """A random loop at rest, excited, and at rest again with an oscillation of 1 to 130 Hz and 2 to 40 um."""
    count = int(random.integers(1, 5))
    moved, lead = int(random.integers(count)), round(random.choice([0.0, random.uniform(0.6, 2.0)]) * RATE)
    request = dict(EXCITATIONS[random.integers(len(EXCITATIONS))])
    kind, lasting = str(request.pop("kind")), random.uniform(1.0, 4.0)
    signal = generate(excitation_from_request(kind, {"axes": "y", "duration": lasting, **request}), RATE).samples[:, 1]
    slow = float(np.exp(random.uniform(np.log(1.0), np.log(130.0))))
    stop = lead + len(signal)
    onset = stop + round(random.uniform(0.3, 2.0) * RATE)
    steps = onset + round((5.0 + 8.0 / slow) * RATE)
    reference, position = np.zeros((2, steps, count))
    reference[lead:stop, moved] = signal
    for axis in range(count):
        natural, ratio = 2.0 * np.pi * random.uniform(40.0, 90.0), random.uniform(0.35, 0.8)
        stiffness = [2.0 * ratio * natural, natural**2]
        b, a, _ = cont2discrete((stiffness, [1.0, *stiffness]), 1.0 / RATE)
        source = reference[:, axis] if axis == moved else 0.02 * reference[:, moved]
        position[:, axis] = random.uniform(-70e-6, 20e-6) + lfilter(b.ravel(), a, source)
        position[:, axis] += random.normal(scale=random.uniform(0.02e-6, 0.5e-6), size=steps)
    axis = int(random.integers(count))
    time = np.arange(steps) / RATE
    phase, amplitude = random.uniform(0.0, 2.0 * np.pi), np.exp(random.uniform(np.log(2e-6), np.log(40e-6)))
    if quiet:
        if lead:  # without a rest no line can be known, except by the speed of the rotor
            position[:, axis] += min(amplitude, 10e-6) * np.sin(2.0 * np.pi * max(slow, 8.0) * time + phase)
        onset = -1
    else:
        since = np.maximum(time - onset / RATE, 0.0)
        rise = 1.0 - np.exp(-since / random.uniform(0.002, 0.5))
        position[:, axis] += amplitude * rise * np.sin(2.0 * np.pi * slow * since + phase)
    names = layout_without_machine(axis_names(count)).axes
    record = LoopRecord(0, 1.0 / RATE, reference, position, np.zeros_like(position), names)
    return AfterStop(record, names[axis], None if quiet else onset)


if __name__ == "__main__":
    start_alone(run)
