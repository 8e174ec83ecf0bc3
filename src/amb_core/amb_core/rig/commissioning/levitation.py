"""The rotor at rest, before levitation and in it, and how a loop that does not levitate went wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.units import UM
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.protocol import Check, at_most, measured
from amb_core.rig.commissioning.settings import CommissioningSettings

SETTLED = 0.5  # s at the end of a record over which rest is judged
_STILL = 5e-6  # m from its final position within which the rotor counts as levitated
_FAR = 0.3  # of the largest motion of all axes: an axis that moved so far ran away, too


def rest_checks(positions: NDArray[np.float64], machine: Machine, settings: CommissioningSettings) -> list[Check]:
    """Sensors while the rotor rests and the currents are off.

    Parameters
    ----------
    positions : ndarray, shape (n, axes)
        Measured positions (m).
    machine : Machine
        Axes and clearances.
    settings : CommissioningSettings
        Limits.

    Returns
    -------
    list of Check
        Position and noise of each axis, and the resting place in each bearing.
    """
    checks = []
    for axis, name in enumerate(machine.axis_names):
        values = positions[:, axis]
        checks.append(measured(f"position of {name}", UM * float(values.mean()), "um"))
        if np.isnan(values).any():
            advice = f"the sensor {name} is not connected, without supply, or out of range"
            checks.append(Check(f"signal of {name}", "none", limit="a position", passed=False, advice=advice))
        elif np.ptp(values) == 0.0:
            checks.append(
                measured(f"noise of {name}", "none at all: a sensor without noise, or stuck; the small steps will show")
            )
        else:
            noise = UM * float(values.std())
            advice = "look for a loose shield, a ground loop, or amplifiers that switch while currents are off"
            checks.append(at_most(f"noise of {name}, rms", noise, UM * settings.noise, "um", advice))
    mean = positions.mean(axis=0)
    advice = "check offset and scale of the sensors of this bearing, and its clearance in the target's configuration"
    for bearing in machine.bearings:
        share = float(np.linalg.norm(mean[machine.columns_of(bearing.name)])) / clearance_of(machine, bearing.name)
        checks.append(
            at_most(f"resting place in bearing {bearing.name} over clearance", share, settings.rest_share, "-", advice)
        )
    return checks


def levitation_checks(
    record: LoopRecord, machine: Machine, limits: NDArray[np.float64], settings: CommissioningSettings
) -> list[Check]:
    """A levitation from its first step until the rotor has been at rest for a while.

    Parameters
    ----------
    record : LoopRecord
        Of the run, from step 0 on.
    machine : Machine
        Axes and clearances.
    limits : ndarray, shape (axes,)
        Limit of the control current of each axis (A).
    settings : CommissioningSettings
        Limits.

    Returns
    -------
    list of Check
        Time until the rotor is at rest; its orbit, place and currents there.
    """
    last = record.window(record.first_step + record.steps - _settled_steps(record), _settled_steps(record))
    place = last.position.mean(axis=0)
    away = np.flatnonzero(
        np.any(np.abs(record.position - place) > max(_STILL, 2.0 * np.abs(last.position - place).max()), axis=1)
    )
    checks = [measured("time until the rotor is at rest", (away[-1] + 1 if len(away) else 0) * record.sample_time, "s")]
    for bearing in (each.name for each in machine.bearings):
        axes = machine.columns_of(bearing)
        orbit = float(np.linalg.norm(last.position[:, axes] - place[axes], axis=1).max())
        clearance = clearance_of(machine, bearing)
        checks.append(measured(f"orbit in bearing {bearing}", UM * orbit, "um"))
        advice = "little damping or much noise: more derivative gain or a filter; if it turns: unbalance"
        checks.append(
            at_most(f"orbit in bearing {bearing} over clearance", orbit / clearance, settings.orbit_share, "-", advice)
        )
    for axis, name in enumerate(machine.axis_names):
        current = last.current[:, axis]
        checks.append(measured(f"position of {name}", UM * float(place[axis]), "um"))
        checks.append(measured(f"control current of {name}", float(current.mean()), "A"))
        share = float(np.abs(current).max()) / float(limits[axis])
        advice = "too little bias or too small a limit for this load"
        checks.append(
            at_most(f"largest control current of {name} over its limit", share, settings.current_share, "-", advice)
        )
    return checks


def runaway(record: LoopRecord, machine: Machine) -> str:
    """How the rotor ran away before a trip, and the likely causes, as one line.

    Parameters
    ----------
    record : LoopRecord
        From where the currents were switched on up to the trip.
    machine : Machine
        Directions of the axes.

    Returns
    -------
    str
        One line of text.
    """
    moved = record.position[-1] - record.position[0]
    if not np.isfinite(moved).all():
        lost = [name for name, value in zip(record.axes, moved, strict=True) if not np.isfinite(value)]
        return f"the sensor of {' and '.join(lost)} lost its signal"
    far = [axis for axis in range(len(moved)) if abs(moved[axis]) > _FAR * np.abs(moved).max() > 0.0]
    ways = [
        f"{record.axes[axis]} went to {UM * record.position[-1, axis]:+.0f} um at {record.current[-1, axis]:+.2f} A"
        for axis in far
    ]
    text = f"within {1e3 * record.steps * record.sample_time:.1f} ms " + ", ".join(ways)
    if len(far) > 1:
        names = " and ".join(record.axes[axis] for axis in far)
        return f"{text}: {names} ran away together: sensors or coils swapped between them, or each with the wrong sign"
    if not far:
        return "the rotor did not move"
    name = record.axes[far[0]]
    if machine.axes[far[0]].direction[1] * moved[far[0]] > 0.0:
        return f"{text}: {name} ran upwards, so it was not the weight; its sensor or its coils have the wrong sign"
    return (
        f"{text}: its sensor or its coils have the wrong sign, are plugged in at another axis, or the current is too "
        "small for the load"
    )


def _settled_steps(record: LoopRecord) -> int:
    return min(round(SETTLED / record.sample_time), record.steps)


def clearance_of(machine: Machine, name: str) -> float:
    """Clearance of a bearing (m)."""
    return next(bearing.clearance for bearing in machine.bearings if bearing.name == name)
