"""Closed-loop fits of PEM and of simulation focus: data of the simulated bearing and of the known plant of order 10.

The simulated bearing is shaken by the square waves of `amb demo`; the known plant is that of `make bench-ident`. Other
data, of which the models know nothing, are a multisine; for a model from a multisine they are squares.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np

from amb_core.excitation import Excitation, Multisine, Square, generate
from amb_core.identification import IdentificationData, Method, StateSpaceModel, identify, nrmse_fit, pem, ssarx
from amb_core.identification.estimate.pem import MOST_ITERATIONS
from amb_core.identification.experiment_simulation import simulate_experiment
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from tests.benchmarks.ident import plant as known
from tests.front_door.figures import Figures

CASES = (
    ("simulator", 4),
    ("simulator", 6),
    ("simulator", 10),
    ("squares", 6),
    ("multisine", 6),
    ("squares_noise10", 10),
)
"""Data and order."""
SEED, OTHER_SEED = 0, 100  # of the known plant's noise and multisines
OTHER_STEPS = 20_000
SETTLING = 2_000  # steps until the rotor of the simulator has come to rest, as in the demo
PAPER = ControllerParameters()
SMALLEST: dict[str, Any] = {"steps": 3_000, "other_steps": 500, "iterations": 2, "start": "ssarx"}


class Fitted(Figures):
    """A model: closed-loop fit (percent) on its own data and on others, one-step errors (nm, rms); x and y."""

    own: list[float]
    other: list[float]
    one_step_nm: list[float]


class Case(Figures):
    """Models of one order from the same data."""

    pem: Fitted
    focus: Fitted


class Identification(Figures):
    """All cases, by data and order."""

    steps: int
    other_steps: int
    seed: int
    simulator_4: Case
    simulator_6: Case
    simulator_10: Case
    squares_6: Case
    multisine_6: Case
    squares_noise10_10: Case


def measure(
    steps: int = known.STEPS,
    other_steps: int = OTHER_STEPS,
    iterations: int = MOST_ITERATIONS,
    start: Method = "pem",
) -> dict[str, object]:
    """Fits of both kinds of models, from as many samples.

    PEM stops after the iterations; simulation focus begins with a model of the method `start`.
    """
    sizes = {"steps": steps, "other_steps": other_steps, "seed": SEED}
    return sizes | {
        f"{name}_{order}": _case(name, order, (steps, other_steps), iterations, start) for name, order in CASES
    }


def _case(name: str, order: int, sizes: tuple[int, int], iterations: int, start: Method) -> dict[str, object]:
    controller = PAPER if name == "simulator" else known.CONTROLLER
    own, other = _simulated(*sizes) if name == "simulator" else _known(name, *sizes)
    record = own.record(0)
    first = ssarx(record.current, record.position, record.sample_time, order)
    models = {
        "pem": pem(record.current, record.position, first, most_iterations=iterations, second_start=True),
        "focus": identify(own, order, start, controller, focus="simulation").model,
    }
    return {
        key: {
            "own": _fit(model, own, controller),
            "other": _fit(model, other, controller),
            "one_step_nm": (1e9 * np.sqrt(np.diag(model.innovation_covariance))).tolist(),
        }
        for key, model in models.items()
    }


@functools.cache
def _simulated(steps: int, other_steps: int) -> tuple[IdentificationData, IdentificationData]:
    """Square waves of 50 um, x then y, and a multisine of 10 um up to 200 Hz, which leaves the bearing in region A."""
    seconds, others = steps * known.SAMPLE_TIME, other_steps * known.SAMPLE_TIME
    squares = Square(amplitude=50e-6, duration=seconds, axes="in_turn")
    multisine = Multisine(amplitude=10e-6, duration=others, frequency_start=1.0, frequency_end=200.0)
    return _shaken(squares), _shaken(multisine)


def _shaken(excitation: Excitation) -> IdentificationData:
    signal = generate(excitation, PAPER.sample_rate)
    record = simulate(Plant(), PdController(PAPER), SETTLING + signal.steps, signal.samples, SETTLING)
    return IdentificationData.from_record(record.window(SETTLING, signal.steps))


def _known(name: str, steps: int, other_steps: int) -> tuple[IdentificationData, IdentificationData]:
    experiment = known.DATA_SETS[name]
    unlike = "squares" if experiment.excitation == "multisine" else "multisine"
    records: tuple[LoopRecord, LoopRecord] = (
        known.record(replace(experiment, steps=steps), SEED),
        known.record(known.Experiment(unlike, steps=other_steps), OTHER_SEED),
    )
    own, other = map(IdentificationData.from_record, records)
    return own, other


def _fit(model: StateSpaceModel, data: IdentificationData, controller: ControllerParameters) -> list[float]:
    """As `amb validate`: from the reference alone, with the first state that predicts the outputs best."""
    simulated = simulate_experiment(model, data, 0, controller)
    return nrmse_fit(data.record(0).position, simulated.position).tolist()
