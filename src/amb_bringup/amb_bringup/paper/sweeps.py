"""The paper's sweep: 10 Hz to 5 kHz in 20 s on y, of one amplitude, until the rotor delevitates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import ExcitationSignal, Sweep, generate
from amb_core.figures.sweep_comparison import SweepCase, onset_summary
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.regions import Classification, Onset, Region, RegionState, classify
from amb_core.report import Answer
from amb_core.simulation import simulate_first_bearing
from amb_core.simulation.parameters import with_values

ONE_AXIS = {"magnetic_circuit.actuators": "differential"}
"""The paper's bearing with 1 DOF: electromagnets above and below the rotor."""

SLOW_AMPLIFIER = {"amplifier.supply_voltage": 30.0}
"""A tenth of the paper's supply voltage: current loop ten times slower, slew limit ten times lower."""

SLOW_NOTE = (
    "Why a slower amplifier: with the parameters of table 1 as we read them, the current follows its reference up to "
    "kilohertz. The paper does not state how the output of its amplifiers' PI controllers is scaled, so its amplifiers "
    "may be slower than ours. The second bearing therefore has a tenth of the supply voltage; all else is equal. "
    "That value is ours, not the paper's."
)

REST = 1.0  # s, before the sweep: the rotor settles at its sag
SWEEP = {"frequency": "10 Hz to 5 kHz in 20 s, linear", "axis": "y", "before the sweep": f"{REST:g} s at rest"}


@dataclass(frozen=True)
class SweptBearing:
    """A bearing after the sweep.

    Attributes
    ----------
    plant : Plant
        Its state at the end.
    controller : ControllerParameters
        Its controller.
    record : LoopRecord
        Rest and sweep, up to the delevitation.
    frequency : ndarray, shape (steps,)
        Frequency of the input at each step (Hz), NaN at rest.
    found : Classification
        The regions.
    """

    plant: Plant
    controller: ControllerParameters
    record: LoopRecord
    frequency: NDArray[np.float64]
    found: Classification

    @property
    def onsets(self) -> dict[Region, Onset]:
        """Onsets of B, C and D, if they occur."""
        return self.found.onsets

    def case(self, name: str) -> SweepCase:
        """The case under a name, for a comparison with others."""
        return SweepCase(name, self.record, self.frequency, self.found)

    @property
    def summary(self) -> str:
        """Where the regions begin, such as `B from 417 Hz, D from 1839 Hz`."""
        return onset_summary(self.case(""))

    def states_in(self, region: Region) -> list[RegionState]:
        """The states in a region."""
        return [state for state in self.found.states if state.region is region]


def paper_sweep(amplitude: float, sample_rate: float, axis: Literal["x", "y"] = "y") -> ExcitationSignal:
    """The sweep with an amplitude (m)."""
    sweep = Sweep(amplitude=amplitude, frequency_start=10.0, frequency_end=5_000.0, duration=20.0, axes=axis)
    return generate(sweep, sample_rate)


def sweep_bearing(
    amplitude: float, values: Mapping[str, Any] | None = None, axis: Literal["x", "y"] = "y"
) -> SweptBearing:
    """Simulate the sweep and find its regions.

    Parameters
    ----------
    amplitude : float
        Of the reference (m).
    values : mapping, optional
        Differences from the paper's bearing, by the names of `amb_core.simulation.parameters`.
    axis : str
        The axis that is swept.
    """
    parameters, controller = with_values(PlantParameters(), ControllerParameters(), values or {})
    plant, signal = Plant(parameters), paper_sweep(amplitude, controller.sample_rate, axis)
    rest = round(REST * controller.sample_rate)
    record = simulate_first_bearing(plant, controller, rest + signal.steps, signal.samples, rest)
    assert signal.frequency is not None  # a sweep has one
    frequency = np.concatenate([np.full(rest, np.nan), signal.frequency])[: record.steps]
    found = classify(record, delevitated=plant.delevitated, frequency=frequency)
    return SweptBearing(plant, controller, record, frequency, found)


def in_order(bearing: SweptBearing) -> bool:
    """Whether B begins some time after the start of the sweep, then C, and D, if it occurs, last."""
    onsets = bearing.onsets
    if Region.B not in onsets or Region.C not in onsets:
        return False
    steps = [onsets[region].step for region in (Region.B, Region.C, Region.D) if region in onsets]
    rest = int(np.argmax(np.isfinite(bearing.frequency)))
    return rest < steps[0] and steps == sorted(set(steps))


def order_verdict(paper: SweptBearing, slow: SweptBearing) -> tuple[Answer, str]:
    """Whether the regions come in the paper's order, with table 1 or only with the slow amplifier; and why not."""
    if in_order(paper):
        return "agrees", ""
    if in_order(slow):
        return (
            "agrees in part",
            "With table 1 as we read it a region is missing or out of order; with a tenth of the supply voltage all "
            "come in order. The paper does not state how its amplifiers are scaled.",
        )
    return "does not agree", "Neither bearing shows A, B and C in this order."
