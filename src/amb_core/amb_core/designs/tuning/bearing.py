"""A bearing by the few numbers that its owner knows, and the plant that they make.

What is not given has the proportions of the paper's bearing (table 1). The power amplifiers get the paper's current
loop, scaled; see `amb_core.designs.tuning.current_loop`.
"""

from __future__ import annotations

import math
from typing import Any

from pydantic import model_validator

from amb_core.designs.tuning.current_loop import GAINS, current_loop_gains, rounded
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import Parameters, quantity, required, validate
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.parameters import MagneticCircuitParameters

_PAPER = MagneticCircuitParameters()
STEPS_PER_PERIOD = tuple(20 * 2**power for power in range(10))
"""Internal steps in a switching period; more where eddy currents are fast, or the period is long."""
LONGEST_STEP = 5e-6  # s
SMALLEST_CLEARANCE = 1e-6  # m
FASTEST_SWITCHING = 1e6  # Hz


class Bearing(Parameters):
    """One radial bearing of two axes with a point mass, in the words of its owner."""

    gap: float = required("m", "air gap between pole and journal, rotor centred", 5e-5, 5e-3)
    turns: int = required("-", "turns on each pole; two poles in series make an electromagnet", 1, 10_000)
    mass: float = required("kg", "mass that this bearing carries: half of a rotor in two bearings", 1e-3, 1e5)
    bias_current: float = required("A", "bias current of every electromagnet", 1e-3, 100.0)
    voltage: float = required("V", "supply voltage of the amplifiers: a coil sees plus or minus this", 1.0, 5000.0)
    sample_rate: float = quantity(10_000.0, "Hz", "sample rate of the controller", 1e3, 1e5)
    journal_diameter: float = quantity(69.9e-3, "m", "outer diameter of the journal", 5e-3, 0.9)
    length: float = quantity(49.15e-3, "m", "axial length of the magnets", 1e-3, 1.0)
    pole_width: float = quantity(0.0, "m", "width of a pole; 0: as in the paper's bearing, in proportion", 0.0, 1.0)
    resistance: float = quantity(0.2, "ohm", "resistance of the two coils of an electromagnet", 0.0, 100.0)
    current_limit: float = quantity(0.0, "A", "largest coil current; 0: twice the bias current", 0.0, 100.0)
    clearance: float = quantity(0.0, "m", "distance from the centre to the backup bearing; 0: half the gap", 0.0, 5e-3)
    sensor_bandwidth: float = quantity(0.0, "Hz", "first-order low-pass of the position sensors; 0: none", 0.0, 1e6)
    delay: float = quantity(0.0, "-", "computing time as a part of a controller sample", 0.0, 1.0)
    switching_frequency: float = quantity(
        100e3,
        "Hz",
        "switching frequency of the amplifiers, rounded to whole periods in a sample",
        1e3,
        FASTEST_SWITCHING,
    )
    gravity: float = quantity(9.81, "m/s^2", "gravity across the bearing; 0 for a vertical rotor", 0.0, 100.0)

    @model_validator(mode="after")
    def _fits_together(self) -> Bearing:
        if 0.0 < self.clearance < SMALLEST_CLEARANCE:
            raise ValueError(
                f"clearance = {self.clearance:g} m is not allowed; allowed: 0, or {SMALLEST_CLEARANCE:g} m and more"
            )
        if self.clearance >= self.gap:
            raise ValueError(f"clearance = {self.clearance:g} m must be smaller than gap = {self.gap:g} m")
        if 0.0 < self.current_limit <= self.bias_current:
            raise ValueError(
                f"current_limit = {self.current_limit:g} A must be larger than bias_current = {self.bias_current:g} A"
            )
        if self.switching_frequency < self.sample_rate:
            raise ValueError(
                f"switching_frequency = {self.switching_frequency:g} Hz must be at least sample_rate = "
                f"{self.sample_rate:g} Hz"
            )
        return self

    @property
    def control_current_limit(self) -> float:
        """Largest control current: what is left of the coil's limit above the bias (A)."""
        return (self.current_limit or 2.0 * self.bias_current) - self.bias_current


def plant_of(bearing: Bearing) -> PlantParameters:
    """The plant of a bearing.

    Parameters
    ----------
    bearing : Bearing
        What is known of the bearing.

    Returns
    -------
    PlantParameters
        Its parameters; everything else has its default.

    Raises
    ------
    ParameterError, PlantError
        If its numbers do not make a bearing.
    """
    problem: PlantError | None = None
    values = _values(bearing)
    switching = values["amplifier.switching_frequency"]
    longer = math.ceil(1.0 / (switching * STEPS_PER_PERIOD[0] * LONGEST_STEP))
    for steps in STEPS_PER_PERIOD:
        values["integration.internal_step"] = 1.0 / (switching * longer * steps)
        parameters = validate(PlantParameters, values)
        try:
            Plant(parameters)
        except PlantError as refusal:
            problem = refusal
            continue
        gains = dict(zip(GAINS, current_loop_gains(parameters), strict=True))
        return validate(PlantParameters, values | gains)
    assert problem is not None
    raise problem


def _values(bearing: Bearing) -> dict[str, Any]:
    circuit = {f"magnetic_circuit.{name}": value for name, value in _circuit(bearing).items()}
    return circuit | {
        "amplifier.supply_voltage": bearing.voltage,
        "amplifier.switching_frequency": _switching_frequency(bearing),
        "amplifier.bias_current": bearing.bias_current,
        "amplifier.current_limit": bearing.bias_current + bearing.control_current_limit,
        "rotor.mass": bearing.mass,
        "rotor.gravity": bearing.gravity,
        "rotor.backup_bearing_radius": bearing.clearance or rounded(0.5 * bearing.gap),
        "sensor.bandwidth": bearing.sensor_bandwidth,
        "converters.computation_delay": bearing.delay,
        "integration.sample_rate": bearing.sample_rate,
    }


def _switching_frequency(bearing: Bearing) -> float:
    """The nearest one of whole periods in a sample that the amplifiers can have (Hz)."""
    most = math.floor(FASTEST_SWITCHING / bearing.sample_rate + 1e-9)  # rounding can leave a ratio below its integer
    periods = min(max(round(bearing.switching_frequency / bearing.sample_rate), 1), most)
    return min(periods * bearing.sample_rate, FASTEST_SWITCHING)  # and a product above the largest value


def _circuit(bearing: Bearing) -> dict[str, float]:
    """Radii and pole width in the proportions of the paper's bearing."""
    journal = 0.5 * bearing.journal_diameter
    pole = journal + bearing.gap
    return {
        "air_gap": bearing.gap,
        "axial_length": bearing.length,
        "journal_inner_radius": rounded(journal * _PAPER.journal_inner_radius / _PAPER.journal_outer_radius),
        "journal_outer_radius": journal,
        "pole_radius": pole,
        "back_iron_inner_radius": rounded(pole * _PAPER.back_iron_inner_radius / _PAPER.pole_radius),
        "stator_outer_radius": rounded(pole * _PAPER.stator_outer_radius / _PAPER.pole_radius),
        "pole_width": bearing.pole_width or rounded(pole * _PAPER.pole_width / _PAPER.pole_radius),
        "turns_per_pole": bearing.turns,
        "coil_resistance": bearing.resistance,
    }
