"""One sweep of a region map: simulated, classified, reduced to its boundaries. The unit of work, and of the cache."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import Sweep, generate
from amb_core.ground.errors import RegionError
from amb_core.ground.parameters import flatten, part_of
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.loop_task import LoopTask
from amb_core.plant.simulation import simulate
from amb_core.regions import Classification, RegionParameters, classify
from amb_core.regions.region_map.map_sweep import Boundary, MapSweep, sweep_from_json, sweep_to_json


@dataclass(frozen=True)
class SweepTask(LoopTask[MapSweep]):
    """Everything that determines the result of one sweep.

    Attributes
    ----------
    sweep : Sweep
        The excitation; its axes are those of the plant's machine.
    rest : float
        Time without excitation before it (s).
    plant, controller, regions : PlantParameters, ControllerParameters, RegionParameters
        The loop, and the thresholds of the classifier. Subclasses (parameters of nodes) are reduced to these. Unless
        `regions` has a running speed, it is that of the plant.
    """

    sweep: Sweep
    rest: float
    plant: PlantParameters
    controller: ControllerParameters
    regions: RegionParameters

    def __post_init__(self) -> None:
        super().__post_init__()
        regions = self.regions.model_dump()
        regions["running_speed"] = regions["running_speed"] or 2.0 * math.pi * self.plant.rotor.running_speed
        object.__setattr__(self, "regions", part_of(RegionParameters, regions))
        # A region map does not use what happens after touch-down, so the run may end there.
        plant = {**flatten(self.plant.model_dump()), "backup_bearing.contact": False}
        object.__setattr__(self, "plant", part_of(PlantParameters, plant))

    def describe(self) -> dict[str, Any]:
        """What determines the result, as plain JSON values: parameters, files they name, version of the code."""
        own = {"sweep": self.sweep.model_dump(), "rest": self.rest, "regions": self.regions.model_dump()}
        return super().describe() | own

    def run(self) -> MapSweep:
        """Simulate and classify the sweep; see `run_sweep`."""
        return run_sweep(self)

    to_json = staticmethod(sweep_to_json)
    from_json = staticmethod(sweep_from_json)


def run_sweep(task: SweepTask) -> MapSweep:
    """Simulate a sweep from rest until it ends or the rotor delevitates, and find where its regions begin.

    Raises
    ------
    RegionError
        If the rotor does not stay levitated before the sweep begins.
    PlantError, ExcitationError
        If the plant or the sweep cannot be made.
    """
    sample_rate = task.controller.sample_rate
    plant = Plant(task.plant)
    signal = generate(task.sweep, sample_rate, plant.machine)
    rest = round(task.rest * sample_rate)
    controller = PdController(task.controller, len(plant.machine.axes))
    record = simulate(plant, controller, rest + signal.steps, signal.samples, rest)
    if record.steps <= rest and plant.delevitated:
        raise RegionError(
            f"the rotor delevitates {record.steps / sample_rate:.3g} s after it is released, before the sweep begins "
            f"at {task.rest:g} s; the loop does not hold it"
        )
    assert signal.frequency is not None
    frequency = np.concatenate([np.full(rest, task.sweep.frequency_start), signal.frequency])[: record.steps]
    classification = classify(
        record, task.regions, machine=plant.machine, delevitated=plant.delevitated, frequency=frequency
    )
    return MapSweep(
        amplitude=task.sweep.amplitude,
        boundaries={
            region: Boundary(onset.input_frequency, onset.resonance) for region, onset in classification.onsets.items()
        },
        beats=_beats(classification, frequency),
        highest_frequency=float(frequency[-1]),
        steps=record.steps,
    )


def _beats(classification: Classification, frequency: NDArray[np.float64]) -> tuple[tuple[float, float], ...]:
    """Spans of the input frequency (Hz) over which an axis beat with the sample rate."""
    beating = [state.sampling_beat for state in classification.states]
    edges = np.flatnonzero(np.diff([False, *beating, False]))
    steps = [min(state.step, len(frequency) - 1) for state in classification.states]
    return tuple(
        (float(frequency[steps[first]]), float(frequency[steps[last - 1]]))
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    )
