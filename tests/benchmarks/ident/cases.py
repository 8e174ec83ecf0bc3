"""The data sets of the benchmark: plants with their true models, the data of each seed, and how models are judged."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from amb_core.identification import StateSpaceModel, closed_loop_poles, simulate_closed_loop
from tests.benchmarks.ident import plant
from tests.benchmarks.ident.linear_loop import LinearLoop, multisine, squares
from tests.benchmarks.ident.rotors import rotor4, siso

VALIDATION_STEPS = 20_000
_VALIDATION_SEED = 1_000_000  # far from those of the data

Arrays = NDArray[np.float64]


class Case(Protocol):
    """A plant in closed loop, and the experiment that its data come from.

    Attributes
    ----------
    name : str
        Of the data set.
    true : StateSpaceModel
        The plant in innovations form, for the noise of the experiment.
    """

    name: str

    @property
    def true(self) -> StateSpaceModel:
        """See `Case`."""

    def data(self, seed: int, steps: int = plant.STEPS) -> tuple[Arrays, Arrays]:
        """Inputs (A) and outputs (m) of the experiment."""

    def validation(self, excitation: str) -> tuple[Arrays, Arrays]:
        """Reference and true response without noise (m), to `squares` or a `multisine` that no method has seen."""

    def simulate(self, model: StateSpaceModel, reference: Arrays) -> Arrays:
        """Response (m) of the loop of model and controller; IdentificationError where it diverges."""

    def poles(self, model: StateSpaceModel) -> NDArray[np.complex128]:
        """Poles in the z plane of the loop of model and controller."""


@dataclass(frozen=True)
class BearingCase:
    """The bearing of `plant`, controlled as in the workbench."""

    name: str

    @property
    def true(self) -> StateSpaceModel:
        """The bearing in innovations form."""
        return plant.true_model(plant.DATA_SETS[self.name].noise)

    def data(self, seed: int, steps: int = plant.STEPS) -> tuple[Arrays, Arrays]:
        """Inputs (A) and outputs (m)."""
        record = plant.record(replace(plant.DATA_SETS[self.name], steps=steps), seed)
        return record.current, record.position

    def validation(self, excitation: str) -> tuple[Arrays, Arrays]:
        """Reference and response (m)."""
        record = plant.record(plant.Experiment(excitation, 0.0, VALIDATION_STEPS), _VALIDATION_SEED)
        return record.reference, record.position

    def simulate(self, model: StateSpaceModel, reference: Arrays) -> Arrays:
        """Response (m) of the loop."""
        return simulate_closed_loop(model, plant.CONTROLLER, reference).position

    def poles(self, model: StateSpaceModel) -> NDArray[np.complex128]:
        """Poles of the loop."""
        return closed_loop_poles(model, plant.CONTROLLER)


@dataclass(frozen=True)
class LinearCase:
    """A linear loop under independent multisines on all axes."""

    name: str
    loop: Callable[[], LinearLoop]

    @property
    def true(self) -> StateSpaceModel:
        """The plant in innovations form."""
        return self.loop().true_model

    def data(self, seed: int, steps: int = plant.STEPS) -> tuple[Arrays, Arrays]:
        """Inputs (A) and outputs (m)."""
        reference = multisine(self.loop().axes, steps, np.random.default_rng([seed, 0]))
        return self.loop().run(reference, np.random.default_rng([seed, 1]))

    def validation(self, excitation: str) -> tuple[Arrays, Arrays]:
        """Reference and response (m)."""
        axes, random = self.loop().axes, np.random.default_rng(_VALIDATION_SEED)
        if excitation == "squares":
            reference = squares(axes, VALIDATION_STEPS)
        else:
            reference = multisine(axes, VALIDATION_STEPS, random)
        return reference, self.loop().run(reference)[1]

    def simulate(self, model: StateSpaceModel, reference: Arrays) -> Arrays:
        """Response (m) of the loop."""
        return self.loop().simulate(model.a, model.b, model.c, reference)

    def poles(self, model: StateSpaceModel) -> NDArray[np.complex128]:
        """Poles of the loop."""
        return self.loop().poles(model.a, model.b, model.c)


CASES: dict[str, Case] = {
    **{name: BearingCase(name) for name in plant.DATA_SETS},
    "rotor4": LinearCase("rotor4", rotor4),
    "siso": LinearCase("siso", siso),
}


@functools.lru_cache(maxsize=4)
def validation(name: str, excitation: str) -> tuple[Arrays, Arrays]:
    """As `Case.validation`, kept."""
    return CASES[name].validation(excitation)
