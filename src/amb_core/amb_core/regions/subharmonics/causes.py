"""Causes of the products: the same test with one effect of the loop switched off at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Variant:
    """A loop that differs from a given one in one respect.

    Attributes
    ----------
    name : str
        The difference, in words.
    values : dict
        Changed parameters, with names as in `amb_core.plant.simulation.parameters`.
    """

    name: str
    values: dict[str, Any]


# The slew limit is the amplifier's duty limit, which only an amplifier without switching can lack. The variant before
# it has no switching either, to separate the two effects. A control current reference of 100 A is never reached; coil
# currents keep their own limit.
VARIANTS = (
    Variant("as given", {}),
    Variant("no gravity", {"rotor.gravity": 0.0}),
    Variant("coil currents may be negative", {"amplifier.unipolar": False}),
    Variant("average voltage, no switching", {"amplifier.switching": False}),
    Variant("no slew limit, no coil current limit", {"amplifier.switching": False, "amplifier.limits": False}),
    Variant("control current limit 10 A", {"controller.current_limit": 10.0}),
    Variant("no control current limit", {"controller.current_limit": 100.0}),
    Variant("derivative on measurement", {"controller.derivative_on": "measurement"}),
    Variant("sampled at 20 kHz", {"integration.sample_rate": 20e3}),
)
