"""How far the rotor moved from the middle of its bearings, for the zones after ISO 14839-2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from amb_core.data.experiments import RecordedLoop, restore
from amb_core.plant.machine import machine_of


def largest_displacements(loops: Sequence[RecordedLoop]) -> dict[str, float]:
    """Largest displacement over clearance of each axis, in all data of a plant that is known.

    It counts from the middle of the clearance, so trends that were removed are added again, and in a bearing of two
    axes it is the radius.

    Parameters
    ----------
    loops : sequence of RecordedLoop
        The data.

    Returns
    -------
    dict of str to float
        By the name of the axis (-); axes of one bearing have one value. Empty if no plant is known.
    """
    largest: dict[str, float] = {}
    for loop in loops:
        if loop.plant is None:
            continue
        machine = machine_of(loop.plant)
        clearances = {bearing.name: bearing.clearance for bearing in machine.bearings}
        bearing_of = {axis.name: axis.bearing for axis in machine.axes}
        names = loop.data.output_names
        experiments = restore(loop.data).experiments
        for name in names:
            bearing = bearing_of.get(name)
            together = [other == name or (bearing is not None and bearing_of.get(other) == bearing) for other in names]
            moved = max(float(np.linalg.norm(item.outputs[:, together], axis=1).max()) for item in experiments)
            share = moved / clearances.get(bearing or "", loop.plant.rotor.backup_bearing_radius)
            largest[name] = max(largest.get(name, 0.0), share)
    return largest
