"""What a certificate assumes and demands: sizes of the uncertainties, confidence, limits of the zones.

Sources: ISO 14839-3 (zones by the peak of the sensitivity) and ISO 14839-2 (zones by displacement over clearance); the
default limits are to be checked against the standards themselves before a certificate is signed.
"""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from amb_core.ground.errors import RobustnessError
from amb_core.ground.parameters import Parameters, choice, quantity

Zone = Literal["A", "B", "C", "D"]
ZONES: tuple[Zone, ...] = ("A", "B", "C", "D")
SENSITIVITY_LIMITS = (3.0, 4.0, 5.0)  # ends of the zones A, B and C
DISPLACEMENT_LIMITS = (0.3, 0.4, 0.5)
USUAL_CONFIDENCE = 0.95  # with less, a verdict names it


class RobustnessSettings(Parameters):
    """Settings of a certificate."""

    actuator: float = quantity(0.05, "-", "complex uncertainty of each actuator: gain and phase", 0.0, 0.9)
    sensor: float = quantity(0.05, "-", "complex uncertainty of each sensor: gain and phase", 0.0, 0.9)
    current_gain: float = quantity(0.05, "-", "relative uncertainty of the current gain k_i, real", 0.0, 0.9)
    negative_stiffness: float = quantity(0.1, "-", "relative uncertainty of the negative stiffness k_s, real", 0.0, 0.9)
    bending_frequency: float = quantity(0.02, "-", "relative uncertainty of bending frequencies, real", 0.0, 0.2)
    bending_damping: float = quantity(0.2, "-", "relative uncertainty of the damping of bending modes, real", 0.0, 0.9)
    extra_delay: float = quantity(
        0.0, "steps", "computation delay in addition to that of the data, also part of a step", 0.0, 100.0
    )
    mode_damping: float = quantity(0.001, "-", "least damping ratio of modes that the model may lack", 1e-4, 0.1)
    mode_ring_down: float = quantity(1.0, "s", "longest time constant of the decay of such modes", 0.01, 1_000.0)
    mode_gain: float = quantity(
        0.1, "-", "largest gain of modes beyond the excited band, relative to the rotor's own motion", 0.0, 100.0
    )
    operation_amplitude: float = quantity(
        0.0, "m", "largest motion from the middle in operation; 0: not compared with the data", 0.0, 1e-3
    )
    confidence: float = quantity(0.99, "-", "confidence of the bounds", 0.5, 0.9999)
    frequencies: float = quantity(500.0, "-", "number of frequencies of the curves", 50.0, 5_000.0)
    skew: float = quantity(0.0, "-", "skew sigma of the disk margins", -1.0, 1.0)
    zone_a: float = quantity(3.0, "-", "peak sensitivity at the end of zone A (ISO 14839-3)", 1.0, 100.0)
    zone_b: float = quantity(4.0, "-", "peak sensitivity at the end of zone B (ISO 14839-3)", 1.0, 100.0)
    zone_c: float = quantity(5.0, "-", "peak sensitivity at the end of zone C (ISO 14839-3)", 1.0, 100.0)
    displacement_a: float = quantity(0.3, "-", "displacement over clearance at the end of zone A (ISO 14839-2)", 0, 1)
    displacement_b: float = quantity(0.4, "-", "displacement over clearance at the end of zone B (ISO 14839-2)", 0, 1)
    displacement_c: float = quantity(0.5, "-", "displacement over clearance at the end of zone C (ISO 14839-2)", 0, 1)
    needed_zone: Literal["A", "B", "C"] = choice("A", "worst zone after ISO 14839-3 with which a loop is certified")

    @model_validator(mode="after")
    def _limits_rise(self) -> RobustnessSettings:
        for what, limits in (("zone", self.sensitivity_limits), ("displacement", self.displacement_limits)):
            if not limits[0] <= limits[1] <= limits[2]:
                given = ", ".join(f"{limit:g}" for limit in limits)
                raise ValueError(f"{what}_a, {what}_b and {what}_c = {given} are not allowed; they must rise")
        return self

    @property
    def own_terms(self) -> str:
        """In which of the limits that decide these settings differ from the standards'; empty if in none."""
        terms = []
        for what, limits, usual in (
            ("ISO 14839-3", self.sensitivity_limits, SENSITIVITY_LIMITS),
            ("ISO 14839-2", self.displacement_limits, DISPLACEMENT_LIMITS),
        ):
            if limits != usual:
                own, theirs = (", ".join(f"{limit:g}" for limit in one) for one in (limits, usual))
                terms.append(f"zones end at {own}, not at the {theirs} of {what}")
        if self.needed_zone != "A":
            terms.append(f"zone {self.needed_zone} is taken as enough")
        if self.confidence < USUAL_CONFIDENCE:
            terms.append(f"the confidence is {100.0 * self.confidence:g} % only")
        return "; ".join(terms)

    @property
    def sensitivity_limits(self) -> tuple[float, float, float]:
        """Ends of the zones A, B and C by peak sensitivity."""
        return self.zone_a, self.zone_b, self.zone_c

    @property
    def displacement_limits(self) -> tuple[float, float, float]:
        """Ends of the zones A, B and C by displacement over clearance."""
        return self.displacement_a, self.displacement_b, self.displacement_c


def zone_of(value: float, limits: tuple[float, float, float]) -> Zone:
    """The zone of a value, of which a limit belongs to the better zone.

    Parameters
    ----------
    value : float
        Peak sensitivity, or displacement over clearance (-).
    limits : tuple of float
        Ends of the zones A, B and C (-), rising.

    Returns
    -------
    Zone
        A, B, C or D.

    Raises
    ------
    RobustnessError
        If the limits do not rise.
    """
    if not limits[0] <= limits[1] <= limits[2]:
        raise RobustnessError(f"limits of zones {limits} are not allowed; they must rise")
    return ZONES[sum(not value <= limit for limit in limits)]
