"""What makes the products: the same test with one effect of the loop switched off at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from amb_core.control import ControllerParameters
from amb_core.parameters import P, flatten, validate
from amb_core.plant import PlantParameters

CONTROLLER = "controller."  # prefix of the controller's parameters; all others are the plant's


@dataclass(frozen=True)
class Variant:
    """A loop that differs from a given one in one respect.

    Attributes
    ----------
    name : str
        What is different, in words.
    values : dict
        Parameters that are changed, named as `with_values` has it.
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


def with_values(
    plant: PlantParameters, controller: ControllerParameters, values: Mapping[str, Any]
) -> tuple[PlantParameters, ControllerParameters]:
    """The parameters of a loop with some values changed.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.
    values : mapping
        By name: a dotted name of `PlantParameters` (rotor.gravity) or `controller.` and a name of
        `ControllerParameters` (controller.current_limit).

    Raises
    ------
    ParameterError
        If a name is unknown or a value out of its range.
    """
    of_controller = {name: value for name, value in values.items() if name.startswith(CONTROLLER)}
    of_plant = {name: value for name, value in values.items() if name not in of_controller}
    return (
        _changed(plant, of_plant),
        _changed(controller, {name.removeprefix(CONTROLLER): value for name, value in of_controller.items()}),
    )


def _changed(parameters: P, values: Mapping[str, Any]) -> P:
    return validate(type(parameters), {**flatten(parameters.model_dump()), **values})
