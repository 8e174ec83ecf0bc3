"""Excitation check: in which regions of a region map an excitation would run (paper, section 3.5, Fig. 11 and 12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.designs.excitation.command import ABOVE_A, command, limits
from amb_core.designs.excitation.content import Content, content_of
from amb_core.designs.excitation.linear_response import LinearLoop, effective_current_limit, slew_rate
from amb_core.designs.excitation.load import AxisLoad, amplitude_margin
from amb_core.designs.excitation.notes import made_with, notes_on, require_same_machine
from amb_core.designs.excitation.request import Request, request_on
from amb_core.designs.excitation.result import AxisCheck, ExcitationCheck
from amb_core.designs.excitation.spans import spans_on_one_bearing
from amb_core.excitation import ExcitationSignal
from amb_core.ground.errors import ExcitationError
from amb_core.ground.given_values import require_kind
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import RegionMap

SATURATED = 0.01
"""Share of samples beyond a limit of current or voltage above which the map's region A is not the whole answer."""


def check_excitation(
    signal: ExcitationSignal,
    region_map: RegionMap,
    controller: ControllerParameters | None = None,
    plant: PlantParameters | None = None,
) -> ExcitationCheck:
    """Superimpose an excitation on a region map; the method is described in `docs/explanation/excitation.md`.

    Parameters
    ----------
    signal : ExcitationSignal
        From `amb_core.excitation.generate`.
    region_map : RegionMap
        Of the bearing that is to be excited.
    controller, plant : ControllerParameters, PlantParameters, optional
        Of that bearing; by default those the map was made with. Other parameters of the controller are reported in
        `notes`.

    Returns
    -------
    ExcitationCheck
        Points on the map, loads and margins of each excited axis, and a verdict.

    Raises
    ------
    ExcitationError
        If the signal is made for more than one bearing, or is zero throughout on an excited axis, the map is of another
        machine, or the loop is unstable.
    RegionError
        If neither the map nor the caller gives the parameters of the loop.
    PlantError
        If the controller cannot hold the rotor.
    """
    require_kind("signal", signal, ExcitationSignal, "an ExcitationSignal, as generate makes one", ExcitationError)
    allowed = "a RegionMap, such as RegionMap.load(path)"
    require_kind("region_map", region_map, RegionMap, allowed, ExcitationError)
    spans = spans_on_one_bearing(signal)
    controller = controller or made_with(region_map, "controller", ControllerParameters)
    plant = plant or made_with(region_map, "plant", PlantParameters)
    require_same_machine(region_map, plant)
    loop = LinearLoop(Plant(plant), controller)
    current_limit, rate = effective_current_limit(plant, controller), slew_rate(plant, loop.static_current)
    linear = loop.respond(signal.samples)
    axes, loads = zip(
        *(
            _superimpose(
                signal,
                axis,
                (first, last),
                region_map,
                controller,
                request_on(axis, (first, last), linear, loop.static_current, current_limit, rate, signal.sample_time),
            )
            for axis, first, last in spans
        ),
        strict=True,
    )
    predicted = max(axis.predicted for axis in axes)
    map_margin = amplitude_margin(loads)
    return ExcitationCheck(
        kind=signal.kind,
        axes=axes,
        shares=_shares(axes),
        predicted=predicted,
        certain=predicted > Region.A or all(axis.load.linear < 1.0 for axis in axes),
        margin=min(map_margin, *(min(axis.current_margin, axis.slew_margin) for axis in axes)),
        verdict=verdict(axes, map_margin),
        notes=(
            *(text for axis in axes for text in saturation(axis, 0.0)),
            *notes_on(signal, axes, region_map, controller, plant),
        ),
        bias_current=plant.amplifier.bias_current,
        current_limit=current_limit,
        slew_rate=rate,
        map_margin=map_margin,
    )


def _shares(axes: Sequence[AxisCheck]) -> dict[Region, float]:
    """Share of the power of all axes in each region (-)."""
    power = np.array([axis.rms**2 for axis in axes])
    return {
        region: float(sum(weight * axis.shares[region] for weight, axis in zip(power / power.sum(), axes, strict=True)))
        for region in Region
    }


def verdict(axes: tuple[AxisCheck, ...], map_margin: float) -> str:
    """One line: the region on the axis with the highest load, why, and what to do."""
    allowed = _allowed_factor(axes, map_margin)
    worst = max(axes, key=lambda axis: (axis.predicted, axis.load.linear))
    load = worst.load
    if worst.predicted > Region.A:
        where = ""
        if worst.form == "instantaneous":
            entered = worst.frequency[worst.region > Region.A]
            where = f" at {entered.min():.0f} Hz to {entered.max():.0f} Hz" if len(entered) else ""
        elif worst.shares[Region.A] > 0.999:
            where = " by all of its content together"
        return (
            f"region {worst.predicted.name} on {worst.axis}{where}: the load is {load.linear:.2f} times the limit of "
            f"region A; multiply the amplitude by at most {allowed}, or lower the frequencies"
        )
    if load.linear >= 1.0:
        return (
            f"region A on {worst.axis} is not certain: {load.bounded:.2f} of a load of at most {load.linear:.2f} comes "
            f"from where the map shows no boundary; multiply the amplitude by at most {allowed}, widen the map, or "
            "simulate"
        )
    saturated = [text for axis in axes for text in saturation(axis, SATURATED)]
    if saturated:
        return (
            f"region A by the map, where the load is {load.linear:.2f} times its limit, but {'; '.join(saturated)}: "
            f"multiply the amplitude by at most {allowed}, or lower the frequencies, and simulate"
        )
    return f"region A: the load is {load.linear:.2f} times its limit; the amplitude may be multiplied by {allowed}"


def _allowed_factor(axes: tuple[AxisCheck, ...], map_margin: float) -> str:
    """The factor that the map and the limits of current and voltage allow, and what limits it if not the map."""
    margins = [(map_margin, "")]
    for axis in axes:
        margins.append((axis.current_margin, f"the limit of the current on {axis.axis}"))
        margins.append((axis.slew_margin, f"the voltage on {axis.axis}"))
    factor, what = min(margins)
    return f"{factor:.2f}" + (f" (by {what}; {map_margin:.2f} by the map)" if what else "")


def saturation(axis: AxisCheck, beyond: float) -> list[str]:
    """What the linear loop requests of an axis beyond current and voltage, in more than a share of the samples."""
    return [
        f"on {axis.axis} {what} in {100.0 * share:.2g} % of the samples"
        for share, what in (
            (axis.limited, f"the control current, with {abs(axis.static_current):.2f} A at rest, exceeds its limit"),
            (axis.slewed, "the control current changes faster than the voltage can drive it"),
        )
        if share > beyond
    ]


def _superimpose(
    signal: ExcitationSignal,
    axis: int,
    span: tuple[int, int],
    region_map: RegionMap,
    controller: ControllerParameters,
    request: Request,
) -> tuple[AxisCheck, AxisLoad]:
    samples = signal.samples[span[0] : span[1], axis]
    if not samples.any():
        raise ExcitationError(f"{signal.kind}: the signal on {'xy'[axis]} is zero; there is nothing to check")
    content = content_of(signal, span, axis)
    region, covered = _place(content, region_map, controller)
    current = command(samples, controller, signal.sample_time)
    axis_load = AxisLoad(content, current, signal.sample_time, region_map, controller, request.limit)
    load = axis_load.at()
    check = AxisCheck(
        axis="xy"[axis],
        form=content.form,
        frequency=content.frequency,
        amplitude=content.amplitude,
        share=content.share,
        region=region,
        covered=covered,
        shares={name: float(content.share[region == name].sum()) for name in Region},
        load=load,
        predicted=max((name for name in ABOVE_A if load.towards[name] >= 1.0), default=Region.A),
        rms=_rms(samples),
        peak=float(np.max(np.abs(samples))),
        static_current=request.static,
        command_rms=_rms(request.current),
        command_peak=float(np.max(np.abs(request.static + request.current))),
        slew_rms=_rms(request.slew),
        slew_peak=float(np.max(np.abs(request.slew))),
        limited=request.limited,
        slewed=request.slewed,
        current_margin=request.current_margin(SATURATED),
        slew_margin=request.slew_margin(SATURATED),
    )
    return check, axis_load


def _place(
    content: Content, region_map: RegionMap, controller: ControllerParameters
) -> tuple[NDArray[np.int_], NDArray[np.bool_]]:
    """Region of each point, and whether the map shows it."""
    region = np.full(len(content.frequency), int(Region.A))
    begins = {name: limits(region_map, name, content.frequency, controller) for name in ABOVE_A}
    for name, begin in begins.items():
        region[begin.reached & (content.amplitude >= begin.amplitude)] = int(name)
    settings = region_map.settings
    smallest, largest = region_map.amplitudes[[0, -1]]
    covered = (content.frequency >= settings.frequency_start) & (content.frequency <= settings.frequency_end)
    # An amplitude below those of the map is in A where the smallest one of the map is; elsewhere it is not known.
    linear = begins[Region.B].known | ~begins[Region.B].reached
    return region, covered & (content.amplitude <= largest) & ((content.amplitude >= smallest) | linear)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
