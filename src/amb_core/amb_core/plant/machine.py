"""The machine that a simulated plant is."""

from __future__ import annotations

import math

from amb_core.loop.machine import DIRECTIONS, Machine, MachineAxis, MachineBearing
from amb_core.loop.records import axis_names
from amb_core.plant.parameters import AmplifierParameters, PlantParameters
from amb_core.plant.thrust_bearing import thrust_amplifier

THRUST = "thrust"
"""Name of the thrust bearing."""


def machine_of(parameters: PlantParameters) -> Machine:
    """Axes and bearings of a plant: A alone for a point mass, A and B for a rotor in two, then a thrust bearing."""
    bearings = "a" if parameters.rotor.model == "point_mass" else "ab"
    amplifier = parameters.amplifier
    axes = [
        MachineAxis(
            name=name,
            bearing=bearings[number // 2],
            sensor_position=_axial(parameters, "sensor", bearings[number // 2]),
            actuator_position=_axial(parameters, "bearing", bearings[number // 2]),
            direction=DIRECTIONS["xy"[number % 2]],
            bias_current=amplifier.bias_current,
            current_limit=_current_limit(amplifier),
        )
        for number, name in enumerate(axis_names(2 * len(bearings)))
    ]
    clearances = dict.fromkeys(bearings, parameters.rotor.backup_bearing_radius)
    if parameters.rotor.axial:
        axes.append(_thrust_axis(parameters))
        clearances[THRUST] = parameters.thrust_bearing.clearance
    return Machine(
        name=parameters.rotor.model,
        source="simulator",
        sample_rate=parameters.integration.sample_rate,
        axes=tuple(axes),
        bearings=tuple(MachineBearing(name, clearance) for name, clearance in clearances.items()),
    )


def _thrust_axis(parameters: PlantParameters) -> MachineAxis:
    bearing = parameters.thrust_bearing
    return MachineAxis(
        name="z",
        bearing=THRUST,
        sensor_position=bearing.sensor_position,
        actuator_position=bearing.actuator_position,
        direction=DIRECTIONS["z"],
        bias_current=bearing.bias_current,
        current_limit=_current_limit(thrust_amplifier(parameters)),
    )


def _current_limit(amplifier: AmplifierParameters) -> float:
    """Largest control current that coils with a bias current follow (A)."""
    limits = [math.inf]
    if amplifier.unipolar:
        limits.append(amplifier.bias_current)
    if amplifier.limits:
        limits.append(amplifier.current_limit - amplifier.bias_current)
    return min(limits)


def _axial(parameters: PlantParameters, part: str, bearing: str) -> float:
    """Axial position from the centre of mass (m); 0 for a point mass; a file of modes does not contain it."""
    model = parameters.rotor.model
    if model == "rigid":
        return float(getattr(parameters.rigid_rotor, f"{part}_{bearing}"))
    return 0.0 if model == "point_mass" else math.nan
