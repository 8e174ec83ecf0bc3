"""Dead time found in closed-loop data of drawn bearings, with delays of 0 to 3 samples put into the loop.

Ten bearings: point masses, rigid and flexible rotors, amplifiers of 0.7 to 13 kHz, each with five excitations
(multisines of 1 Hz to 2 kHz, PRBS, squares; without and with sensor noise) on the simulator. The controller's current
references are recorded as computed and reach the amplifiers later by the delay. Only bearings whose linear loop is
stable with the longest delay are used: of each random sequence the first.
"""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks.dead_time import dead_times
from amb_core.excitation import excitation_from_request, generate
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, linearize, uniform_shaft
from amb_core.plant.linearise import close_loop
from tests.benchmarks.regions.spread import spread

SEED = 13
BEARINGS = 10
DELAYS = (0, 1, 2, 3)
STEPS = 12_000
WARM_UP = 1_000  # steps until the rotor hangs where the controller holds it
CURRENT = 0.4  # A rms that a multisine or PRBS asks for, well below the bias current of 3 A
NOISE = 0.05e-6  # m, rms, as in the benchmark of identification
KINDS = (("multisine", 0.0), ("multisine", NOISE), ("prbs", 0.0), ("prbs", NOISE), ("square", NOISE))
"""Excitation and sensor noise."""
CONTROLLER = ControllerParameters()


@dataclass(frozen=True)
class Case:
    """One run: bearing, delay (samples), excitation and noise as a number of `KINDS`."""

    bearing: int
    delay: int
    kind: int
    steps: int = STEPS


def measure(bearings: int = BEARINGS, steps: int = STEPS) -> dict[str, object]:
    """Runs, runs with a dead time advised that is too long, delayed runs, those with the right dead time advised."""
    cases = [Case(*numbers) for numbers in product(range(bearings), DELAYS, range(len(KINDS)), (steps,))]
    advised = spread(advise, cases)
    delayed = [(case, dead) for case, dead in zip(cases, advised, strict=True) if case.delay]
    return {
        "runs": len(cases),
        "false": sum(max(dead) > case.delay for case, dead in zip(cases, advised, strict=True)),
        "delayed": len(delayed),
        "found": sum(set(dead) == {case.delay} for case, dead in delayed),
        "seeds": [SEED],
    }


def advise(case: Case) -> list[int]:
    """Dead times of i_x and i_y (samples) found in the record of a run."""
    samples = dead_times(IdentificationData.from_record(record(case)))
    return samples if samples is not None else [0, 0]


def record(case: Case) -> LoopRecord:
    """The loop with a delay between controller and amplifiers."""
    parameters = bearing(case.bearing)
    excitation, noise = KINDS[case.kind]
    random = np.random.default_rng([SEED, case.bearing, case.delay, case.kind])
    plant = Plant(parameters)
    axes = len(plant.machine.axes)
    law, reference, errors = PdController(CONTROLLER, axes), *np.zeros((2, WARM_UP + case.steps, axes))
    reference[WARM_UP:, :2] = _excitation(excitation, case.steps, int(random.integers(1 << 30)))
    errors[:, :2] = noise * random.normal(size=(len(errors), 2))
    position, current = np.empty_like(reference), np.zeros((len(reference) + case.delay, axes))
    for step, wanted in enumerate(reference):
        position[step] = plant.position + errors[step]
        answer = law.update(position[step], wanted)
        current[step + case.delay, :2], current[step, 2:] = answer[:2], answer[2:]  # bearing B has no delay
        plant.advance(current[step])
    parts = reference, position, current[case.delay :]
    return LoopRecord(0, plant.sample_time, *(part[WARM_UP:, :2] for part in parts))  # bearing A


@functools.cache
def bearing(number: int) -> PlantParameters:
    """The first bearing of a random sequence whose loop is stable with every delay."""
    random = np.random.default_rng([SEED, number])
    while True:
        parameters = _drawn(("point_mass", "rigid", "flexible")[number % 3], random)
        plant = linearize(Plant(parameters), CONTROLLER).discrete
        loops = [close_loop(_delayed(plant, delay), CONTROLLER)[0] for delay in DELAYS]
        if all(np.abs(loop.poles()).max() < 1.0 for loop in loops):
            return parameters


def _drawn(model: str, random: np.random.Generator) -> PlantParameters:
    """Current controllers of 0.05 to 1 per ampere, 0.7 to 13 kHz; rotors of 4 to 9 kg in a bearing."""
    values: dict[str, dict[str, object]] = {
        "amplifier": {"proportional_gain": float(np.exp(random.uniform(np.log(0.05), 0.0))), "switching": False},
        "rotor": {"model": model, "mass": random.uniform(4.0, 9.0)},
        "integration": {"internal_step": 1e-6},
    }
    if model == "rigid":
        values["rigid_rotor"] = {
            "mass": random.uniform(9.0, 16.0),
            "transverse_inertia": random.uniform(0.15, 0.35),
            "sensor_a": random.uniform(-0.17, -0.13),
        }
    if model == "flexible":
        length, diameter = random.uniform(0.5, 0.8), random.uniform(0.04, 0.065)
        at, damping = 0.5 * length * random.uniform(0.6, 0.9), random.uniform(0.003, 0.02)
        shaft = uniform_shaft(length, diameter, (-at, at), bending_modes=2, damping_ratio=damping)
        path = Path(tempfile.mkdtemp()) / "shaft.npz"
        shaft.save(path)
        values["flexible_rotor"] = {"modal_data": str(path)}
    return PlantParameters.model_validate(values)


def _delayed(plant: LinearSystem, samples: int) -> LinearSystem:
    """The plant whose inputs of bearing A come later."""
    a, b, c = plant.a, plant.b, plant.c
    own = np.diag((np.arange(plant.inputs) < 2).astype(float))
    for _ in range(samples):
        zero = np.zeros((len(own), len(a)))
        a = np.block([[a, b @ own], [zero, np.zeros_like(own)]])
        b = np.vstack([b @ (np.eye(len(own)) - own), own])
        c = np.hstack([c, np.zeros_like(own)])
    return plant.with_matrices(a, b, c, plant.d)


def _excitation(kind: str, steps: int, seed: int) -> NDArray[np.float64]:
    """Reference positions (m); a multisine or PRBS that makes the control current `CURRENT` with the rotor at rest."""
    rate = CONTROLLER.sample_rate
    if kind == "square":  # an edge asks for 2.3 A
        request: dict[str, object] = {"amplitude": 3e-6, "frequency": 100.0, "duration": steps / rate}
        return generate(excitation_from_request(kind, request), rate).samples
    request = {"amplitude": 20e-6, "duration": steps / rate, "seed": seed}
    if kind == "multisine":
        request |= {"frequency_start": 1.0, "frequency_end": 2_000.0}
    samples = generate(excitation_from_request(kind, request), rate).samples
    rates = np.diff(samples, axis=0, prepend=0.0) * rate
    current = CONTROLLER.proportional_gain * samples + CONTROLLER.derivative_gain * rates
    return samples * (CURRENT / current.std(axis=0).mean())
