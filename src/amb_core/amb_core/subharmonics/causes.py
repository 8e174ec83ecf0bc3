"""What makes the products: the same test with one effect of the loop switched off at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from amb_core.control import ControllerParameters
from amb_core.parameters import flatten, validate
from amb_core.plant import PlantParameters


@dataclass(frozen=True)
class Variant:
    """A loop that differs from a given one in one respect.

    Attributes
    ----------
    name : str
        What is different, in words.
    plant, controller : dict
        Parameters that are changed, by dotted name.
    """

    name: str
    plant: dict[str, Any]
    controller: dict[str, Any]

    def apply(
        self, plant: PlantParameters, controller: ControllerParameters
    ) -> tuple[PlantParameters, ControllerParameters]:
        """The parameters with the changes."""
        return (
            validate(PlantParameters, {**flatten(plant.model_dump()), **self.plant}),
            validate(ControllerParameters, {**flatten(controller.model_dump()), **self.controller}),
        )


# The slew limit is the amplifier's duty limit, without which only the average voltage can be applied; so the variant
# before it has the average voltage alone, to tell the two apart. The limit of 100 A on the control current reference is
# never reached; the coil current references keep their own.
VARIANTS = (
    Variant("as given", {}, {}),
    Variant("no gravity", {"rotor.gravity": 0.0}, {}),
    Variant("coil currents may be negative", {"amplifier.unipolar": False}, {}),
    Variant("average voltage, no switching", {"amplifier.switching": False}, {}),
    Variant(
        "no slew limit, no limit of coil currents", {"amplifier.switching": False, "amplifier.limits": False}, {}
    ),
    Variant("no eddy currents", {"iron.eddy_currents": False}, {}),
    Variant("control current limit 10 A", {}, {"current_limit": 10.0}),
    Variant("no control current limit", {}, {"current_limit": 100.0}),
    Variant("derivative on measurement", {}, {"derivative_on": "measurement"}),
    Variant(
        "sampled at 20 kHz",
        {"integration.sample_rate": 20e3, "controller_b.sample_rate": 20e3},
        {"sample_rate": 20e3},
    ),
)  # fmt: skip
