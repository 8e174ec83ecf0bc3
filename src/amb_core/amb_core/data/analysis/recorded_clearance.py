"""The clearances of a recorded machine: without them region D is not judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from amb_core.ground.parameters import part_of
from amb_core.loop.machine import Machine
from amb_core.recording import Recording
from amb_core.recording.messages.parameters import ParameterValue
from amb_core.recording.recording import SIMULATOR_NODE
from amb_core.regions.parameters import RegionParameters

MONITOR_NODE = "region_monitor"

Parameters = Mapping[str, ParameterValue]


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


def known_clearance(
    axes: Iterable[str], machine: Machine | None, simulated: Parameters | None, monitored: Parameters | None
) -> dict[str, float]:
    """The clearances that a graph knows, running or recorded: from its region monitor, its machine or its simulator.

    Parameters
    ----------
    axes : iterable of str
        Names of the axes.
    machine : Machine or None
        As topic `machine` describes it; one with other axes is left out.
    simulated, monitored : mapping or None
        Parameters of the simulator and of the region monitor by dotted name. None if they are not known.

    Returns
    -------
    dict of str to float
        By axis, where it is known: displacement from the centre at which the rotor touches its bearing (m).
    """
    axes = tuple(axes)
    radius = (simulated or {}).get("rotor.backup_bearing_radius")
    known = radial_clearance(axes, radius if isinstance(radius, float) else None)
    if machine is not None and machine.axis_names == axes:
        known = machine.clearances
    given = part_of(RegionParameters, monitored or {}).backup_bearing_radius
    return known | radial_clearance(axes, given or None)


def recorded_clearance(recording: Recording, axes: Iterable[str], run: int | None = None) -> dict[str, float]:
    """The clearances that are known of a recorded run: from its user, its file, or as `known_clearance` finds them.

    Parameters
    ----------
    recording : Recording
        A bag, or a file as a recording of one run.
    axes : iterable of str
        Names of its axes.
    run : int, optional
        Number of the run; by default the last one.

    Returns
    -------
    dict of str to float
        By axis, where it is known: displacement from the centre at which the rotor touches its bearing (m).
    """
    axes = tuple(axes)
    simulated, monitored = recording.parameters_of(SIMULATOR_NODE, run), recording.parameters_of(MONITOR_NODE, run)
    known = known_clearance(axes, recording.machine(run), simulated, monitored)
    of_file = {axis: value for axis, value in recording.clearance_of_axis.items() if axis in axes}
    return known | of_file | radial_clearance(axes, recording.clearance)
