"""What makes the products: the same test with one effect of the loop switched off at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Variant:
    """A loop that differs from a given one in one respect.

    Attributes
    ----------
    name : str
        What is different, in words.
    values : dict
        Parameters that are changed, named as `amb_core.simulation.parameters` has it.
    """

    name: str
    values: dict[str, Any]


# The slew limit is the amplifier's duty limit, which only an amplifier without switching can lack; the variant before
# it has no switching either, to tell the two apart. A control current reference of 100 A is never reached; coil
# currents keep a limit of their own.
VARIANTS = (
    Variant("as given", {}),
    Variant("no gravity", {"rotor.gravity": 0.0}),
    Variant("coil currents may be negative", {"amplifier.unipolar": False}),
    Variant("average voltage, no switching", {"amplifier.switching": False}),
    Variant("no slew limit, no coil current limit", {"amplifier.switching": False, "amplifier.limits": False}),
    Variant("control current limit 10 A", {"controller.current_limit": 10.0}),
    Variant("no control current limit", {"controller.current_limit": 100.0}),
    Variant("derivative on measurement", {"controller.derivative_on": "measurement"}),
    Variant(
        "sampled at 20 kHz",
        {
            "integration.sample_rate": 20e3,
            "controller_b.sample_rate": 20e3,
            "controller.sample_rate": 20e3,
        },
    ),
)
