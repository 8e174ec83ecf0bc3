"""One dwell of a region map: a fixed sine, approached smoothly, and the region in which the loop then stays.

A dwell starts at rest. The amplitude of a sine rises smoothly at one frequency (the start), the frequency then moves
smoothly to its final value, and stays there. The region is that of the settled motion, in the second half of the time
at the final frequency:

- D: the rotor delevitated, at any time since the start;
- C: the classifier shows C in this half, so a slow oscillation goes on;
- B: the mean position lies by the classifier's drift threshold or more from the one at rest. A sweep shows B where the
  mean position moves as fast; a fixed sine holds the rotor there, or lets it drift on. As in the classifier, it does
  not count within the loop's bandwidth, where the response is `resonance_gain` times the input or more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation.axes import factors_of
from amb_core.ground.errors import RegionError
from amb_core.ground.tasks.task import Task
from amb_core.loop.control import PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_core.regions import Classification, Region, RegionParameters, classify
from amb_core.regions.region_map.settings import ConfirmationSettings
from amb_core.regions.region_map.sweep_run import SweepTask

SHORTEST_REST = 0.5  # s, before every dwell: the mean position at rest is taken over the second half of it


@dataclass(frozen=True)
class Dwell:
    """The result of one dwell.

    Attributes
    ----------
    frequency : float
        The fixed frequency (Hz).
    region : Region
        Region of the settled motion.
    started : bool
        Whether the rotor was still levitated when the frequency left its start; always true where it stays there.
    displacement : float
        Distance of the mean position from the one at rest, of the axis on which it is larger (m); 0 in region D.
    steps : int
        Controller steps simulated.
    """

    frequency: float
    region: Region
    started: bool
    displacement: float
    steps: int


@dataclass(frozen=True)
class DwellTask(Task[Dwell]):
    """Everything that determines the result of one dwell.

    Attributes
    ----------
    sweep : SweepTask
        The sweep of the same amplitude: loop, thresholds, axes and time at rest are its own.
    frequency, start : float
        The fixed frequency, and the one at which the sine starts (Hz).
    settings : ConfirmationSettings
        Times of the dwell.
    """

    sweep: SweepTask
    frequency: float
    start: float
    settings: ConfirmationSettings

    def describe(self) -> dict[str, Any]:
        """What determines the result, as plain JSON values: parameters, files they name, version of the code."""
        swept = self.sweep.describe()
        return {name: swept[name] for name in ("rest", "plant", "controller", "regions", "files", "code")} | {
            "dwell": {
                "amplitude": self.sweep.sweep.amplitude,
                "axes": self.sweep.sweep.axes,
                "frequency": self.frequency,
                "start": self.start,
                "time": self.settings.dwell,
                "ramp": self.settings.ramp,
            }
        }

    def run(self) -> Dwell:
        """Simulate and judge the dwell; see `run_dwell`."""
        return run_dwell(self)

    @staticmethod
    def to_json(result: Dwell) -> dict[str, Any]:
        """A dwell as JSON values."""
        return {
            "frequency": result.frequency,
            "region": result.region.name,
            "started": result.started,
            "displacement": result.displacement,
            "steps": result.steps,
        }

    @staticmethod
    def from_json(entry: dict[str, Any]) -> Dwell:
        """The dwell that `to_json` wrote; KeyError, TypeError or ValueError for anything else."""
        return Dwell(
            float(entry["frequency"]),
            Region[entry["region"]],
            bool(entry["started"]),
            float(entry["displacement"]),
            int(entry["steps"]),
        )


def run_dwell(task: DwellTask) -> Dwell:
    """Simulate a dwell from rest until it ends or the rotor delevitates, and find the region of the settled motion.

    Raises
    ------
    RegionError
        If the rotor does not stay levitated before the sine begins.
    PlantError
        If the plant cannot be built.
    """
    loop, settings = task.sweep, task.settings
    rate = loop.controller.sample_rate
    rest, ramp, hold = (round(time * rate) for time in (max(loop.rest, SHORTEST_REST), settings.ramp, settings.dwell))
    sine, frequency = dwell_signal(task.start, task.frequency, ramp, hold, rate)
    plant = Plant(loop.plant)
    samples = loop.sweep.amplitude * sine[:, None] * factors_of(loop.sweep.axes, plant.machine)
    controller = PdController(loop.controller, len(plant.machine.axes))
    record = simulate(plant, controller, rest + len(sine), samples, rest)
    if record.steps <= rest and plant.delevitated:
        raise RegionError(f"the rotor delevitates {record.steps / rate:.3g} s after it is released; see the sweeps")
    if plant.delevitated:
        started = task.start == task.frequency or record.steps > rest + ramp
        return Dwell(task.frequency, Region.D, started, 0.0, record.steps)
    known = np.concatenate([np.full(rest, task.start), frequency])
    classification = classify(record, loop.regions, machine=plant.machine, delevitated=False, frequency=known)
    settled = rest + 2 * ramp + hold // 2
    displacement, drifted = _displacement(record, slice(rest // 2, rest), settled, task)
    region = Region.B if drifted else Region.A
    if _oscillates(classification, settled):
        region = Region.C
    return Dwell(task.frequency, region, True, displacement, record.steps)


def dwell_signal(
    start: float, frequency: float, ramp: int, hold: int, rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sine of amplitude 1 that starts smoothly at one frequency, moves smoothly to another one and stays there.

    Amplitude, and then the logarithm of the frequency, follow half a period of a cosine.

    Parameters
    ----------
    start, frequency : float
        First and last frequency (Hz).
    ramp, hold : int
        Samples of each of the two smooth changes, and at the last frequency.
    rate : float
        Sample rate (Hz).

    Returns
    -------
    samples, frequencies
        Sine and its frequency (Hz), shape (2 ramp + hold,).
    """
    smooth = 0.5 - 0.5 * np.cos(np.pi * (np.arange(ramp) + 0.5) / ramp)
    amplitude = np.concatenate([smooth, np.ones(ramp + hold)])
    moved = np.concatenate([np.zeros(ramp), smooth, np.ones(hold)])
    frequencies = start * (frequency / start) ** moved
    cycles = np.concatenate([[0.0], np.cumsum(0.5 * (frequencies[1:] + frequencies[:-1]))]) / rate
    return amplitude * np.sin(2.0 * np.pi * cycles), frequencies


def _displacement(record: LoopRecord, at_rest: slice, settled: int, task: DwellTask) -> tuple[float, bool]:
    """Largest distance of the mean position from that at rest (m), and whether it counts as drift on an axis."""
    held = record.position[settled:]
    # The window's side lobes keep the sine, and disturbances that were there before it, out of the mean.
    weight = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, len(held) + 1)[:-1, None])  # Hann's
    phase = np.exp(-2j * np.pi * task.frequency * record.sample_time * np.arange(len(held)))[:, None]
    mean = (weight * held).sum(axis=0) / weight.sum()
    response = 2.0 * np.abs((weight * phase * (held - mean)).sum(axis=0)) / weight.sum()
    distance = np.abs(mean - record.position[at_rest].mean(axis=0))
    regions: RegionParameters = task.sweep.regions
    outside_bandwidth = response < regions.resonance_gain * task.sweep.sweep.amplitude
    return float(distance.max()), bool(np.any((distance >= regions.drift_threshold) & outside_bandwidth))


def _oscillates(classification: Classification, settled: int) -> bool:
    return any(state.step >= settled and state.region == Region.C for state in classification.states)
