"""Bearings of the nonlinear simulator, whose data no linear model explains: iron with hysteresis, and region C.

The paper's bearing with drawn mass, stiffness of the controller and supply voltage. A record is of region C where the
region classifier finds slow oscillation in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import excitation_from_request, generate
from amb_core.identification import IdentificationData
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.simulation import simulate
from amb_core.plant.simulation.parameters import with_values
from amb_core.regions import Region, classify
from amb_core.robustness import measured_sensitivity

HYSTERESIS, REGION_C = "hysteresis", "region C"
SIMULATED = (HYSTERESIS, REGION_C)
SETTLED = 2_000  # steps
PROBE = {"amplitude": 1e-6, "duration": 8.0, "frequency_start": 2.0, "frequency_end": 2_000.0}
"""Motion in which the truth is measured, without noise: deep in region A."""
_SECONDS = 8.0  # of the record in which region C is sought: slower sweeps dwell longer where the rotor falls
_REACH = 4.0  # standard deviations by which a measured sensitivity counts


@dataclass(frozen=True, eq=False)
class SimulatedPlant:
    """A simulated bearing with its experiments; attributes as those of `misfit_plants.MisfitPlant`.

    Attributes
    ----------
    kind : str
        One of `SIMULATED`.
    mild, aggressive : ControllerParameters
        The controller with which the data are taken, and one with more derivative.
    parameters : PlantParameters
        The bearing.
    excitation : str
        `multisine` or `sweep`.
    amplitude : float
        Of the reference (m).
    """

    kind: str
    mild: ControllerParameters
    aggressive: ControllerParameters
    parameters: PlantParameters
    excitation: str
    amplitude: float
    axes: int = 2
    order: int = 10

    @property
    def true(self) -> LinearSystem:
        """From control currents to positions, for motions so small that the bearing is linear."""
        return linearize(Plant(self.parameters), self.mild).discrete

    def record(self, steps: int, seed: int, now: bool = False) -> LoopRecord | None:
        """The loop under its excitation, one axis after the other; None if the rotor falls."""
        del now  # the bearing stays the same
        parameters, _ = with_values(self.parameters, self.mild, {"sensor.noise_seed": seed})
        ends = {"frequency_start": 2.0, "frequency_end": 2_000.0}
        request = {"amplitude": self.amplitude, "duration": steps / self.mild.sample_rate, **ends}
        return _run(parameters, self.mild, self.excitation, request | _seed_of(self.excitation, seed))

    def measured_peaks(self, law: ControllerParameters) -> NDArray[np.float64]:
        """What S of each axis reaches at least on the simulated bearing under a controller; infinite if it falls."""
        quiet, _ = with_values(self.parameters, law, {"sensor.noise": 0.0})
        record = _run(quiet, law, "multisine", PROBE)
        if record is None:
            return np.full(self.axes, np.inf)
        measured = measured_sensitivity(IdentificationData.from_record(record), law)
        return np.nanmax(np.abs(measured.own) - _REACH * measured.deviation, axis=0)


def draw_simulated(kind: str, seed: int) -> SimulatedPlant:
    """A bearing that both of its controllers hold when nothing excites it."""
    random = np.random.default_rng([seed, 3])
    while True:
        plant = _draw(kind, random)
        if plant is not None:
            return plant


def _draw(kind: str, random: np.random.Generator) -> SimulatedPlant | None:
    iron = {"iron.saturation": True, "iron.hysteresis": True} if kind == HYSTERESIS else {}
    values = {
        "rotor.mass": random.uniform(4.0, 7.0),
        "amplifier.supply_voltage": random.uniform(100.0, 300.0) if kind == HYSTERESIS else random.uniform(20.0, 60.0),
        "sensor.noise": 10.0 ** random.uniform(-8.5, -7.5),
        "controller.proportional_gain": ControllerParameters().proportional_gain * random.uniform(0.9, 1.2),
        "controller.derivative_gain": ControllerParameters().derivative_gain * random.uniform(0.8, 1.2),
    }
    parameters, mild = with_values(PlantParameters(), ControllerParameters(), iron | values)
    harder = 10.0 ** random.uniform(np.log10(1.3), np.log10(3.0))
    aggressive = mild.model_copy(update={"derivative_gain": harder * mild.derivative_gain})
    if kind == HYSTERESIS:
        plant = SimulatedPlant(kind, mild, aggressive, parameters, "multisine", 10.0 ** random.uniform(-6.0, -5.0))
    else:
        plant = SimulatedPlant(kind, mild, aggressive, parameters, "sweep", random.uniform(2e-6, 9e-6))
    record = plant.record(round(_SECONDS * mild.sample_rate), 0)
    if record is None:
        return None
    if kind == REGION_C and not any(state.region is Region.C for state in classify(record).states):
        return None
    return plant


def _seed_of(excitation: str, seed: int) -> dict[str, int]:
    return {"seed": seed} if excitation == "multisine" else {}


def _run(parameters: PlantParameters, law: ControllerParameters, kind: str, request: dict) -> LoopRecord | None:
    samples = generate(excitation_from_request(kind, request), law.sample_rate).samples
    record = simulate(Plant(parameters), PdController(law), len(samples) + SETTLED, samples, SETTLED)
    if record.steps < len(samples) + SETTLED:
        return None
    return record.window(SETTLED, len(samples))
