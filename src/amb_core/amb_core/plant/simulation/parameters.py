"""Parameters of a whole loop by one name each: those of the plant, and those of the controller with a prefix."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from amb_core.ground.errors import ParameterError
from amb_core.ground.given_values import require_kind
from amb_core.ground.parameters import P, declarations, flatten, own_declarations, refuse_those_of_machine, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters

CONTROLLER = "controller."  # prefix of the controller's parameters; all others are the plant's


def loop_parameter_names() -> set[str]:
    """All names that `with_values` takes.

    Returns
    -------
    set of str
        Dotted names.
    """
    names = {declaration.name for declaration in declarations(PlantParameters)}
    return names | {CONTROLLER + declaration.name for declaration in own_declarations(ControllerParameters)}


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

    Returns
    -------
    (PlantParameters, ControllerParameters)
        The changed loop.

    Raises
    ------
    ParameterError
        If a name is unknown or a value out of its range.
    """
    require_loop(plant, controller)
    require_kind("values", values, Mapping, "values by name, such as {'rotor.gravity': 0.0}", ParameterError)
    of_controller = {
        name.removeprefix(CONTROLLER): value for name, value in values.items() if name.startswith(CONTROLLER)
    }
    of_plant = {name: value for name, value in values.items() if not name.startswith(CONTROLLER)}
    refuse_those_of_machine(ControllerParameters, of_controller)
    changed = _changed(plant, of_plant)
    return changed, _changed(controller, of_controller).at_rate(changed.integration.sample_rate)


def require_loop(plant: PlantParameters, controller: ControllerParameters) -> None:
    """Check that they are the parameters of a plant and of its controller.

    Parameters
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The loop.

    Raises
    ------
    ParameterError
        If one is something else, such as a `Plant` or a dict.
    """
    require_kind("plant", plant, PlantParameters, "PlantParameters", ParameterError)
    require_kind("controller", controller, ControllerParameters, "ControllerParameters", ParameterError)


def _changed(parameters: P, values: Mapping[str, Any]) -> P:
    return validate(type(parameters), {**flatten(parameters.model_dump()), **values}) if values else parameters
