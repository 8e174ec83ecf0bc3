"""The parameter file of a designed bearing, each value with its unit and meaning as they are declared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from amb_core.designs.tuning.design import BearingDesign
from amb_core.ground.files.parameter_files import CONTROLLERS, PARAMETERS, full_name
from amb_core.ground.parameters import SIMULATOR, Parameters, declarations, flatten
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters

WIDTH = 44  # column of the comments
OF_CONTROLLER = ("proportional_gain", "derivative_gain", "derivative_on", "current_limit", "nominal_reference")


def parameter_file_of(design: BearingDesign) -> str:
    """The text of a file for all nodes that run this bearing.

    Parameters
    ----------
    design : BearingDesign
        From `design_bearing`.

    Returns
    -------
    str
        YAML of ROS parameters.
    """
    plant = flatten(design.plant.model_dump(exclude_unset=True))
    controller = design.tuned.controller.model_dump()
    parts = [
        *(f"# {line}" for line in _head(design)),
        *_section(SIMULATOR, PlantParameters, plant),
        *_section(CONTROLLERS[0], ControllerParameters, {name: controller[name] for name in OF_CONTROLLER}),
    ]
    return "\n".join(parts) + "\n"


def _head(design: BearingDesign) -> Iterable[str]:
    bearing, tuned = design.bearing, design.tuned
    yield (
        f"A bearing with a gap of {1e3 * bearing.gap:g} mm, {bearing.turns} turns a pole, {bearing.bias_current:g} A "
        f"bias, {bearing.mass:g} kg, {bearing.voltage:g} V."
    )
    yield "Units are SI; what is not given here takes its default. Gains: poles placed on the linearised plant, checked"
    yield (
        f"with sampling, delay, amplifiers and sensors: peak sensitivity {tuned.peak_sensitivity:.3g}, stiffness "
        f"{1e-6 * tuned.stiffness:.3g} N/um,"
    )
    yield (
        f"damping {tuned.damping:.3g} N s/m. In simulation the rotor lifts off within {1e3 * design.lift_off.time:.0f} "
        f"ms and rests within {UM * design.lift_off.farthest:.2g} um of the centre."
    )
    yield "After a change of the plant, amb tune gains suggests new gains and amb tune chart draws which are stable."


def _section(node: str, model: type[Parameters], values: Mapping[str, Any]) -> Iterable[str]:
    yield f"{full_name(node)}:"
    yield f"  {PARAMETERS}:"
    group = ""
    for declaration in declarations(model):
        if declaration.name not in values:
            continue
        *parents, leaf = declaration.name.split(".")
        if ".".join(parents) != group:
            group = ".".join(parents)
            yield f"    {group}:"
        text = f"{'  ' * (2 + len(parents))}{leaf}: {_scalar(values[declaration.name])}"
        unit = "" if declaration.unit == "-" else f"{declaration.unit}, "
        yield f"{text:{WIDTH}}# {unit}{declaration.description}"


def _scalar(value: Any) -> str:
    """A value as YAML, on one line; every float has a point, as ROS needs it."""
    plain = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump(plain, default_flow_style=True)).removesuffix("...\n").strip()
