"""Lift-off in the nonlinear simulation: the rotor lies on the backup bearing, the controller starts, the rotor rises.

The contact with the backup bearing is part of this simulation, whether or not it is part of the plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.averaged import coil_references
from amb_core.plant.internal_step import contact_limits
from amb_core.plant.operating_point import static_force
from amb_core.plant.rotor import rotor_mass, rotor_model
from amb_core.plant.simulation import simulate

DURATION = 0.5  # s; a rotor that rises does so within a few periods of some 50 Hz
REST = 0.1  # s at the end, in which it must be at rest at the centre
AT_REST = 0.1  # of the clearance: how far from the centre counts as held there
RESTING = 0.98  # of the clearance: where the rotor lies before


@dataclass(frozen=True)
class LiftOff:
    """How a rotor rose.

    Attributes
    ----------
    levitated : bool
        Whether it ended at rest near the centre, without touching the backup bearing there.
    largest_current : float
        Largest magnitude of the control current reference (A).
    farthest : float
        Largest distance from the centre in the last `REST` seconds (m).
    time : float
        Until it stayed near the centre (s); the whole run if it did not.
    record : LoopRecord
        Reference, position and current of all steps.
    """

    levitated: bool
    largest_current: float
    farthest: float
    time: float
    record: LoopRecord


def lift_off(parameters: PlantParameters, controller: ControllerParameters) -> LiftOff | None:
    """Simulate the lift-off of a machine, from where its weight leaves it; None if it is thrown onto the poles.

    Parameters
    ----------
    parameters : PlantParameters
        The machine.
    controller : ControllerParameters
        Its gains.

    Returns
    -------
    LiftOff or None
        Time and currents of the lift-off.
    """
    plant = Plant(_lying(parameters))
    law, steps = PdController(controller, len(plant.machine.axes)), round(DURATION * parameters.integration.sample_rate)
    try:
        record = simulate(plant, law, steps)
    except PlantError:  # through the backup bearing, so hard that nothing can be computed any more
        return None
    clearance = parameters.rotor.backup_bearing_radius
    rest = AT_REST * clearance + _largest_noise(parameters)
    radius = _radius(record.position)
    away = np.flatnonzero(radius > rest)
    last = int(away[-1]) + 1 if len(away) else 0
    final = radius[-round(REST * parameters.integration.sample_rate) :]
    return LiftOff(
        bool(final.max() <= rest),
        float(np.abs(record.current).max()),
        float(final.max()),
        last * record.sample_time,
        record,
    )


def lift_off_current(parameters: PlantParameters) -> float:
    """Least control current that lifts the rotor off the backup bearing, at its lowest place (A); infinite if none.

    Parameters
    ----------
    parameters : PlantParameters
        The machine.

    Returns
    -------
    float
        The current (A).
    """
    plant = Plant(parameters)
    load = rotor_mass(parameters, plant.rotor) / plant.bearings * parameters.rotor.gravity
    lowest = np.array([0.0, -parameters.rotor.backup_bearing_radius])

    def force(current: float) -> float:
        return float(static_force(plant, coil_references(np.array([0.0, current]), plant), lowest)[1])

    highest = parameters.amplifier.current_limit - parameters.amplifier.bias_current
    if force(highest) <= load:
        return np.inf
    low, high = -parameters.amplifier.bias_current, highest
    while high - low > 1e-4 * parameters.amplifier.bias_current:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if force(middle) < load else (low, middle)
    return high


def _lying(parameters: PlantParameters) -> PlantParameters:
    """The plant with its rotor on the backup bearing, with contact, for a light rotor as soft as its step needs."""
    rotor = None if parameters.rotor.model == "point_mass" else rotor_model(parameters)
    stiffest, strongest = contact_limits(parameters, rotor)
    changes = {
        "rotor.initial_x": 0.0,
        "rotor.initial_y": -RESTING * parameters.rotor.backup_bearing_radius,
        "backup_bearing.contact": True,
        "backup_bearing.stiffness": min(parameters.backup_bearing.stiffness, stiffest),
        "backup_bearing.damping": min(parameters.backup_bearing.damping, strongest),
    }
    return validate(PlantParameters, {**flatten(parameters.model_dump()), **changes})


def _largest_noise(parameters: PlantParameters) -> float:
    """Five standard deviations of the sensors' noise, and a step of the converters (m)."""
    return 5.0 * parameters.sensor.noise + parameters.converters.position_resolution


def _radius(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from the centre of the bearing that is farthest out (m), shape (steps,)."""
    pairs = position[:, : position.shape[1] // 2 * 2].reshape(len(position), -1, 2)
    return np.asarray(np.hypot(pairs[..., 0], pairs[..., 1]).max(axis=1), dtype=np.float64)
