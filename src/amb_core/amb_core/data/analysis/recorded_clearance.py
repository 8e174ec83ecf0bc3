"""The clearances of a recorded machine: without them region D is not judged."""

from __future__ import annotations

import math
from collections.abc import Iterable

from amb_core.ground.parameters import part_of
from amb_core.recording import Recording
from amb_core.recording.recording import SIMULATOR_NODE
from amb_core.regions.parameters import RegionParameters

MONITOR_NODE = "region_monitor"


def radial_clearance(axes: Iterable[str], clearance: float | None) -> dict[str, float]:
    """The clearance that is given for radial bearings, by axis: all but those along the shaft, named z or z and more.

    Parameters
    ----------
    axes : iterable of str
        Names of the axes.
    clearance : float or None
        Displacement from the centre at which the rotor touches a bearing (m); None if it is not known.

    Returns
    -------
    dict of str to float
        The clearance of each radial axis (m); empty if it is not known.
    """
    return {} if clearance is None else {axis: clearance for axis in axes if not axis.startswith("z")}


def recorded_clearance(recording: Recording, axes: Iterable[str]) -> dict[str, float]:
    """The clearances that are known of a recording: from its user, its region monitor, its machine or its simulator.

    Parameters
    ----------
    recording : Recording
        A bag, or a file as a recording of one run.
    axes : iterable of str
        Names of its axes.

    Returns
    -------
    dict of str to float
        By axis, where it is known: displacement from the centre at which the rotor touches its bearing (m).
    """
    axes = tuple(axes)
    simulated = (recording.parameters_of(SIMULATOR_NODE) or {}).get("rotor.backup_bearing_radius")
    known = radial_clearance(axes, simulated if isinstance(simulated, float) else None)
    machine = recording.machine()
    if machine is not None and machine.axis_names == axes:
        of_bearing = {bearing.name: bearing.clearance for bearing in machine.bearings}
        clearances = {axis.name: of_bearing[axis.bearing] for axis in machine.axes}
        known = {axis: clearance for axis, clearance in clearances.items() if 0.0 < clearance < math.inf}
    monitored = part_of(RegionParameters, recording.parameters_of(MONITOR_NODE) or {}).backup_bearing_radius
    return known | radial_clearance(axes, monitored or None) | radial_clearance(axes, recording.clearance)
