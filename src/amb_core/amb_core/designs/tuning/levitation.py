"""Lift-off in the nonlinear simulation: the rotor lies on the backup bearing, the controller starts, the rotor rises.

The contact with the backup bearing is part of this simulation, whether or not it is part of the plant. Without gravity
the bias currents alone hold the rotor down. Whether it rises is judged by the journals themselves, not by what noisy
sensors measure, in a run that is long enough for the slowest motion of the rotor to die out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import AmbError, PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.averaged import coil_references
from amb_core.plant.internal_step import contact_limits
from amb_core.plant.operating_point import static_force
from amb_core.plant.rotor import journal_loads, rotor_model

SHORTEST, LONGEST = 0.5, 20.0  # s of a run; a rotor that rises does so within a few periods of some 50 Hz
TIME_CONSTANTS = 12.0  # of the slowest motion of the rotor in its loop, in a run
REST = 0.2  # of the run, its last part, in which the rotor must be at rest at the centre
AT_REST = 0.1  # of the clearance: how far from the centre counts as held there
STILL = 0.02  # of the clearance: how far the rotor may move meanwhile
FROM_NOISE = 0.5  # of the clearance: what noise may add to both at most
RESTING = 0.999  # of the clearance: where the rotor lies before; it must start inside


@dataclass(frozen=True)
class LiftOff:
    """How a rotor rose.

    Attributes
    ----------
    levitated : bool
        Whether it ended at rest near the centre: hardly moving, and without touching the backup bearing.
    largest_current : float
        Largest magnitude of the control current reference (A).
    farthest : float
        Largest distance of a journal from the centre in the last part of the run, `REST` (m).
    time : float
        Until it stayed near the centre (s); the whole run if it did not.
    record : LoopRecord
        Reference, measured position and current of all steps.
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
    law = PdController(controller, len(plant.machine.axes))
    steps = round(_duration(parameters, controller) * parameters.integration.sample_rate)
    try:
        record, journals, touching = _risen(plant, law, steps)
    except PlantError:  # through the backup bearing, so hard that nothing can be computed any more
        return None
    clearance = parameters.rotor.backup_bearing_radius
    noise = min(_largest_noise(parameters), FROM_NOISE * clearance)
    radius = np.hypot(journals[..., 0], journals[..., 1]).max(axis=1)
    last = slice(-round(REST * len(radius)), None)
    away = np.flatnonzero(radius > AT_REST * clearance + noise)
    still = np.ptp(journals[last], axis=0).max() <= STILL * clearance + noise
    return LiftOff(
        bool(still and not touching[last].any() and radius[last].max() <= AT_REST * clearance + noise),
        float(np.abs(record.current).max()),
        float(radius[last].max()),
        (int(away[-1]) + 1 if len(away) else 0) * record.sample_time,
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
    load = _largest_load(parameters, plant)
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


def _largest_load(parameters: PlantParameters, plant: Plant) -> float:
    """Weight, and constant external force downwards, on the bearing that carries the most (N)."""
    return float(-journal_loads(parameters, plant.rotor)[1::2].min())


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


def _duration(parameters: PlantParameters, controller: ControllerParameters) -> float:
    """Of a run in which the slowest motion of the rotor in its linearised loop dies out (s)."""
    try:
        model = linearize(Plant(parameters), controller)
    except AmbError:  # no place where this controller holds it: it does not come to rest, however long the run
        return SHORTEST
    rates = []
    for axis in model.closed_loop.output_names:
        mode = model.rigid_mode(axis)
        if mode is not None and mode.damping_ratio > 0.0:
            damping = mode.damping_ratio
            slow = damping if damping < 1.0 else 1.0 / (damping + np.sqrt(damping**2 - 1.0))
            rates.append(2.0 * np.pi * mode.natural_hz * slow)
    return float(np.clip(TIME_CONSTANTS / min(rates), SHORTEST, LONGEST)) if rates else SHORTEST


def _risen(plant: Plant, law: PdController, steps: int) -> tuple[LoopRecord, NDArray[np.float64], NDArray[np.bool_]]:
    """Record of a run from where the rotor lies; positions of the journals (m), shape (steps, bearings, 2); contact.

    The run ends early if the rotor is still, or again, on the backup bearing after a time in which others rise.
    """
    plant.reset()
    reference = np.tile(law.nominal_reference, (steps, 1))
    position, current = np.empty_like(reference), np.empty_like(reference)
    journals, touching = np.empty((steps, plant.bearings, 2)), np.zeros(steps, dtype=bool)
    part, done = round(SHORTEST / plant.sample_time), steps
    for step in range(steps):
        position[step] = plant.position
        journals[step] = plant.journals()[0]
        touching[step] = plant.contact
        current[step] = law.update(position[step], reference[step])
        plant.advance(current[step])
        if (step + 1) % part == 0 and touching[step + 1 - round(REST * part) : step + 1].any():
            done = step + 1
            break
    signals = reference[:done], position[:done], current[:done]
    record = LoopRecord(0, plant.sample_time, *signals, plant.machine.axis_names)
    return record, journals[:done], touching[:done]
