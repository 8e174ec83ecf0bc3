"""Notes on an excitation check: limits of the validity of the map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

import numpy as np

from amb_core.designs.excitation.result import AxisCheck
from amb_core.excitation import ExcitationSignal
from amb_core.ground.errors import ExcitationError, ParameterError, RegionError
from amb_core.ground.parameters import Parameters, flatten, validate
from amb_core.loop.control import ControllerParameters, with_present_names
from amb_core.plant import PlantParameters
from amb_core.regions.region_map import RegionMap, confirmation_warnings

P = TypeVar("P", bound=Parameters)

MENTIONED = 1e-3
"""Share of the power or of the load outside the map above which it is mentioned."""
NAMED = 4
"""Largest number of differing parameters that are named."""
NOT_OF_THE_MACHINE = ("integration.internal_step", "sensor.noise")
"""Parameters of the plant that may differ between the machine of a map and the one that is excited: how finely it is
simulated, and the noise of its sensors."""
AFTER_THE_SWEEP = "backup_bearing."
"""Parameters without effect on a map: its sweeps end where the rotor touches the backup bearing."""


def made_with(region_map: RegionMap | None, part: str, model: type[P]) -> P:
    """The parameters with which a map was made, from its provenance.

    Parameters
    ----------
    region_map : RegionMap or None
        The map.
    part : {"controller", "plant"}
        Part of the loop.
    model : type
        `ControllerParameters` or `PlantParameters`.

    Raises
    ------
    RegionError
        If there is no map, or its provenance does not contain them.
    """
    if region_map is None:
        raise RegionError(f"without a region map, specify the parameters of the {part}")
    values = region_map.provenance.get(part)
    if not isinstance(values, Mapping):
        raise RegionError(f"the region map does not contain the parameters of its {part}; specify them")
    try:
        return validate(model, with_present_names(values) if part == "controller" else values)
    except ParameterError as problem:
        raise RegionError(f"this version does not support the {part} of the region map: {problem}") from None


def require_same_machine(region_map: RegionMap, plant: PlantParameters) -> None:
    """Refuse a map of another machine: its boundaries are not those of this one.

    Raises
    ------
    ExcitationError
        If a parameter of the bearing, the amplifiers, the rotor, the sensors (but their noise) or the sample rate
        differs from that of the map. A map that does not contain them is not refused; a note then says so.
    """
    other = [
        text for text in _differences(region_map, "plant", PlantParameters, plant)
        if not text.startswith(NOT_OF_THE_MACHINE)
    ]  # fmt: skip
    if other:
        raise ExcitationError(
            f"the region map is of another machine: {_listed(other)}; draw a map of this machine (`amb map --params`), "
            "or check the excitation for the machine of the map"
        )


def notes_on(
    signal: ExcitationSignal,
    axes: tuple[AxisCheck, ...],
    region_map: RegionMap,
    controller: ControllerParameters,
    plant: PlantParameters,
) -> tuple[str, ...]:
    """Notes on content outside the map, and on a map of another loop."""
    return (
        *_by_axis({axis.axis: list(_outside(axis, region_map)) for axis in axes}),
        *([] if region_map.complete else ["the map is not complete: its boundaries are coarser than requested"]),
        *confirmation_warnings(region_map),
        *_made_otherwise(region_map, "controller", ControllerParameters, controller),
        *_made_otherwise(region_map, "plant", PlantParameters, plant),
        *_other_rate(signal, controller),
    )


def _by_axis(notes: dict[str, list[str]]) -> Iterator[str]:
    """Notes on each axis; equal notes on both axes are given once."""
    for text in dict.fromkeys(text for texts in notes.values() for text in texts):
        yield f"{' and '.join(axis for axis, texts in notes.items() if text in texts)}: {text}"


def _outside(axis: AxisCheck, region_map: RegionMap) -> Iterator[str]:
    settings = region_map.settings
    smallest, largest = 1e6 * region_map.amplitudes[[0, -1]]
    if settings.axes not in (axis.axis, "both"):
        yield f"the map is of sweeps on {settings.axes}"
    for where, outside in (
        (f"below {settings.frequency_start:g} Hz", axis.frequency < settings.frequency_start),
        (f"above {settings.frequency_end:g} Hz", axis.frequency > settings.frequency_end),
        (f"above {largest:.3g} um", 1e6 * axis.amplitude > largest),
    ):
        share = axis.share[outside].sum()
        if share >= MENTIONED:
            yield f"{_percent(share)} of the power lies outside the map, {where}"
    sines_shown = axis.form != "bands" and bool(axis.covered.all())
    if axis.load.continued >= MENTIONED and not sines_shown:
        yield (
            f"{_percent(axis.load.continued)} of the load comes from below {smallest:.3g} um or above "
            f"{settings.frequency_end:g} Hz, where the map is extrapolated at constant control current"
        )


def _made_otherwise(region_map: RegionMap, part: str, model: type[Parameters], parameters: Parameters) -> Iterator[str]:
    """Where parameters differ from those of the map."""
    try:
        made_with(region_map, part, model)
    except RegionError as problem:
        yield str(problem)
        return
    if other := _differences(region_map, part, model, parameters):
        yield f"the map is of another {part}: {_listed(other)}"


def _differences(region_map: RegionMap, part: str, model: type[Parameters], parameters: Parameters) -> list[str]:
    """Parameters that differ from those of the map; none if the map does not contain them."""
    try:
        known = flatten(made_with(region_map, part, model).model_dump())
    except RegionError:
        return []
    asked = flatten(parameters.model_dump())
    return [
        f"{name} = {value} (here {asked[name]})"
        for name, value in known.items()
        if asked[name] != value and not name.startswith(AFTER_THE_SWEEP)
    ]


def _listed(texts: list[str]) -> str:
    return ", ".join(texts[:NAMED]) + (f" and {len(texts) - NAMED} more" if len(texts) > NAMED else "")


def _other_rate(signal: ExcitationSignal, controller: ControllerParameters) -> Iterator[str]:
    rate = 1.0 / signal.sample_time
    if not np.isclose(rate, controller.sample_rate, rtol=1e-9):
        yield f"the signal is sampled at {rate:g} Hz, the controller at {controller.sample_rate:g} Hz"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else "all"
