"""The sweep that the paper states for Fig. 5, assumed for its other figures: 10 Hz to 5 kHz in 20 s on y."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import ExcitationSignal, Sweep, generate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate_first_bearing
from amb_core.plant.simulation.parameters import with_values
from amb_core.regions import Classification, Onset, Region, RegionState, classify
from amb_core.report.figures.sweep_comparison import SweepCase, onset_summary
from amb_paper.study import Setting

ONE_AXIS = {"magnetic_circuit.actuators": "differential"}
"""A bearing with 1 DOF as in the paper's footnote 5: electromagnets above and below the rotor, in differential mode."""

TOP_COIL = {"magnetic_circuit.actuators": "top_coil"}
"""A bearing with 1 DOF as in the paper's eq. (1): only the electromagnet above the rotor carries a current."""

SLOW_AMPLIFIER = {"amplifier.supply_voltage": 30.0}
"""A tenth of the paper's supply voltage: current loop ten times slower, slew limit ten times lower."""

SLOW_VALUE = f"a supply of {SLOW_AMPLIFIER['amplifier.supply_voltage']:g} V"
SLOW_NOTE = (
    "Why a slower amplifier: with electromagnets above and below the rotor, and with two axes, the values of table 1 "
    "lead from region B to D without C. In a bearing whose amplifiers are ten times slower, all regions follow. It has "
    "a tenth of the supply voltage that the paper states; all else is equal. It shows what slow amplifiers do, not "
    "what the paper's bearing does. The scaling of the amplifiers' PI controllers, which the paper leaves open, does "
    "not replace it: with electromagnets above and below, 300 V, and a tenth or three hundredths of K_P, sweeps of "
    "10, 15 and 25 µm show no C either."
)

REST = 1.0  # s, before the sweep: the rotor settles at its sag


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
    classification : Classification
        The regions.
    """

    plant: Plant
    controller: ControllerParameters
    record: LoopRecord
    frequency: NDArray[np.float64]
    classification: Classification

    @property
    def onsets(self) -> dict[Region, Onset]:
        """Onsets of B, C and D, if they occur."""
        return self.classification.onsets

    def case(self, name: str) -> SweepCase:
        """The case under a name, for a comparison with others."""
        return SweepCase(name, self.record, self.frequency, self.classification)

    @property
    def summary(self) -> str:
        """Where the regions begin, such as `B from 417 Hz, D from 1839 Hz`."""
        return onset_summary(self.case(""))

    def states_in(self, region: Region) -> list[RegionState]:
        """The states in a region."""
        return [state for state in self.classification.states if state.region is region]


def sweep_settings(source: str = "assumed, as stated for Fig. 5") -> dict[str, Setting]:
    """Settings of the sweep; by default of another figure than Fig. 5, of which alone the paper states them."""
    return {
        "frequency": Setting("10 Hz to 5 kHz in 20 s, linear", source),
        "axis": Setting("y", source),
        "before the sweep": Setting(f"{REST:g} s at rest"),
    }


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
        Differences from the paper's bearing, by the names of `amb_core.plant.simulation.parameters`.
    axis : str
        The axis that is swept.
    """
    parameters, controller = with_values(PlantParameters(), ControllerParameters(), values or {})
    plant, signal = Plant(parameters), paper_sweep(amplitude, controller.sample_rate, axis)
    rest = round(REST * controller.sample_rate)
    record = simulate_first_bearing(plant, controller, rest + signal.steps, signal.samples, rest)
    assert signal.frequency is not None  # a sweep has one
    frequency = np.concatenate([np.full(rest, np.nan), signal.frequency])[: record.steps]
    clearance = dict.fromkeys(record.axes, parameters.rotor.backup_bearing_radius)
    classification = classify(record, clearance=clearance, delevitated=plant.delevitated, frequency=frequency)
    return SweptBearing(plant, controller, record, frequency, classification)


def in_order(bearing: SweptBearing) -> bool:
    """Whether B begins some time after the start of the sweep, then C, and D, if it occurs, last."""
    rest = int(np.argmax(np.isfinite(bearing.frequency)))
    return {Region.B, Region.C} <= bearing.onsets.keys() and one_after_another(
        {region: onset.step for region, onset in bearing.onsets.items()}, rest
    )


def one_after_another(begins: Mapping[Region, float], start: float) -> bool:
    """Whether the regions that occur begin in the order B, C, D, the first of them some time after the start.

    Parameters
    ----------
    begins : mapping of Region to float
        Step, or frequency of a rising sweep (Hz), at which each region begins.
    start : float
        That of the start of the sweep.
    """
    return all(before < after for before, after in pairwise([start, *(begins[region] for region in sorted(begins))]))


def order_reason(as_stated: Sequence[SweptBearing], slow: SweptBearing) -> str:
    """Why a claim about the order of the regions does not agree, or only in part; empty if it agrees."""
    ordered = [in_order(bearing) for bearing in as_stated]
    if all(ordered):
        return ""
    if any(ordered):
        return (
            "The paper does not state which of these bearings it simulated: not all that keep to its values go through "
            "the regions in order."
        )
    if in_order(slow):
        return (
            "With the values that the paper states a region is missing or out of order; with a tenth of the supply "
            "voltage all come in order."
        )
    return "No bearing shows A, B and C in this order."
