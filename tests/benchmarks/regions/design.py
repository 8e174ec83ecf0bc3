"""Excitations designed for bearings drawn at random: is what is certified true with other seeds, and is it not timid?

Each bearing has another gap, winding, bias, supply, mass and controller, and carries its weight. A multisine is
designed for it. Then new seeds are simulated: the linearised loop must fit both axes to 90 % or more. At twice the
amplitude, the distortion limit must be broken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from amb_core.designs.excitation import Limits, TrialBench, design_excitation
from amb_core.designs.excitation.certificate import Bench
from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.closed_forms import current_gain, inductance, negative_stiffness
from amb_core.plant.linearise import linearize
from tests.benchmarks.regions.spread import spread

BEARINGS = 10
NEW_SEEDS = (101, 102, 103, 104)
SEED = 13
DURATION = 1.0  # s
TOLERANCE = 0.05
FIT = 90.0  # %
LEAST_DAMPING = 0.25
LARGEST_SAG = 0.15  # of the gap


@dataclass(frozen=True)
class Case:
    """A bearing with its controller, and the highest frequency of its excitation (Hz)."""

    number: int
    plant: PlantParameters
    controller: ControllerParameters
    frequency_end: float
    new_seeds: tuple[int, ...] = NEW_SEEDS
    duration: float = DURATION  # s


@dataclass(frozen=True)
class Outcome:
    """Fits of the new seeds on the worse axis (%), and use of the distortion limit at twice the amplitude."""

    number: int
    fits: tuple[float, ...]
    at_twice: float
    limited_by: str


def measure(bearings: int = BEARINGS, new_seeds: int = len(NEW_SEEDS), duration: float = DURATION) -> dict[str, object]:
    """Counts over the bearings and the new seeds."""
    outcomes = spread(
        run, [replace(case, new_seeds=NEW_SEEDS[:new_seeds], duration=duration) for case in draw(bearings)]
    )
    fits = [fit for outcome in outcomes for fit in outcome.fits]
    return {
        "runs": len(fits),
        "fit_90": sum(fit >= FIT for fit in fits),
        "least_fit": round(min(fits), 2),
        "bearings": len(outcomes),
        "limit_broken_at_twice": sum(outcome.at_twice > 1.0 for outcome in outcomes),
        "least_share_of_limit_at_twice": round(min(outcome.at_twice for outcome in outcomes), 3),
        "limited_by": [outcome.limited_by for outcome in outcomes],
        "seeds": {"bearings": SEED, "designed": list(range(Limits().seeds)), "new": list(NEW_SEEDS[:new_seeds])},
    }


def run(case: Case) -> Outcome:
    """Design for a bearing, then try other seeds and twice the amplitude."""
    fields = {"duration": case.duration, "frequency_start": 10.0, "frequency_end": case.frequency_end}
    designed = design_excitation("multisine", fields, None, case.controller, case.plant, tolerance=TOLERANCE)
    bench = TrialBench(case.plant, case.controller)
    values = designed.signal.parameters.model_dump()
    fits = []
    for seed in case.new_seeds:
        signal = generate(excitation_from_request("multisine", {**values, "seed": seed}), case.controller.sample_rate)
        fits.append(min((item.fit for item in bench.run(signal).measures), default=-math.inf))
    return Outcome(case.number, tuple(fits), _at_twice(case, values), designed.limited_by)


def _at_twice(case: Case, values: dict[str, Any]) -> float:
    """Use of the distortion limit by random-phase multisines at twice the amplitude; infinite if the rotor falls."""

    def signal_of(amplitude: float, seed: int) -> Any:
        request = {**values, "amplitude": amplitude, "seed": seed}
        return generate(excitation_from_request("multisine", request), case.controller.sample_rate)

    bench = Bench(case.plant, case.controller, None, Limits(), signal_of, None)
    return bench.use_of_distortion(2.0 * values["amplitude"]).share


def draw(bearings: int, seed: int = SEED) -> list[Case]:
    """Bearings with a stable and damped loop, and a rotor that hangs in the middle part of the gap."""
    random = np.random.default_rng(seed)
    cases: list[Case] = []
    while len(cases) < bearings:
        case = _draw(random, len(cases))
        if case is not None:
            cases.append(case)
    return cases


def _draw(random: np.random.Generator, number: int) -> Case | None:
    gap = random.uniform(0.3e-3, 0.8e-3)
    values: dict[str, Any] = {
        "magnetic_circuit.air_gap": gap,
        "magnetic_circuit.journal_outer_radius": 35.6e-3 - gap,
        "magnetic_circuit.turns_per_pole": int(random.integers(40, 101)),
        "amplifier.bias_current": random.uniform(1.5, 4.0),
        "amplifier.supply_voltage": random.uniform(150.0, 400.0),
        "amplifier.switching_frequency": 1e5,
        "rotor.backup_bearing_radius": 0.4 * gap,
    }
    sketch = validate(PlantParameters, values)
    circuit, bias = sketch.magnetic_circuit, sketch.amplifier.bias_current
    gain, stiffness = current_gain(circuit, bias), negative_stiffness(circuit, bias)
    values["amplifier.proportional_gain"] = _loop_gain(sketch)
    mass = values["rotor.mass"] = random.uniform(0.05, 0.3) * gain * bias / 9.81
    stiff, damping = random.uniform(0.7, 2.0) * stiffness, random.uniform(0.4, 0.8)
    frequency = math.sqrt(stiff / mass)  # rad/s
    controller = ControllerParameters(
        proportional_gain=(stiff + stiffness) / gain,
        derivative_gain=2.0 * damping * mass * frequency / gain,
        current_limit=bias,
    )
    if mass * 9.81 / stiff > LARGEST_SAG * gap:
        return None
    plant = validate(PlantParameters, values)
    try:
        linear = linearize(Plant(plant), controller)
    except PlantError:
        return None
    modes = [linear.rigid_mode(axis) for axis in "xy"]
    if not linear.stable or any(mode is None or mode.damping_ratio < LEAST_DAMPING for mode in modes):
        return None
    natural = frequency / (2.0 * math.pi)
    return Case(number, plant, controller, float(np.clip(random.uniform(4.0, 8.0) * natural, 200.0, 2000.0)))


def _loop_gain(plant: PlantParameters) -> float:
    """Gain of the current control by which an error decays by 0.6 of itself within a switching period (1/A)."""
    amplifier = plant.amplifier
    rate = 2.0 * amplifier.supply_voltage / inductance(plant.magnetic_circuit)
    return 0.6 * amplifier.switching_frequency / rate
