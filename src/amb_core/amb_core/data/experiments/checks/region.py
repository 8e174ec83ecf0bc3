"""Check of the region of operation: no linear model holds outside region A."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from amb_core.data.experiments.checks.faults import frozen_positions
from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.ground.errors import AmbError

if TYPE_CHECKING:
    from amb_core.regions import Onset, Region, RegionParameters

_MEANING = {"B": "the bias drifts", "C": "slow oscillation", "D": "delevitated"}


def check_region(data: IdentificationData, parameters: RegionParameters | None = None) -> Finding:
    """Regions that the classifier finds in the records of the loop; see `amb_core.regions`.

    The check needs positions in m, as many currents in A and the reference, at a rate that the classifier supports.
    Removed trends are added again, because the position is compared with the backup bearing. D is judged where the
    clearance of the data is known, or `backup_bearing_radius` of the parameters.

    Parameters
    ----------
    data : IdentificationData
        Data of the closed loop.
    parameters : RegionParameters, optional
        Thresholds of the classifier; its defaults if None.

    Returns
    -------
    Finding
        The regions found, or why they were not looked for.
    """
    # this loads filters; programs that only estimate should not wait for it
    from amb_core.regions import Judged, classify

    onsets: list[tuple[Region, int, Onset]] = []
    early: list[int] = []  # experiments that end before B and C can be found
    parts: list[Judged] = []
    for index in range(len(data.experiments)):
        try:
            classification = classify(data.record(index), parameters, clearance=data.clearance)
        except AmbError as reason:
            return Finding("region", Severity.INFO, f"not checked: {reason}")
        if not any(state.settled for state in classification.states):
            early.append(index)
        parts.append(classification.judged)
        onsets += [(region, index, onset) for region, onset in classification.onsets.items()]
    judged = Judged.joined(parts)
    if onsets:
        region, index, onset = max(onsets, key=lambda item: item[0])
        frequency = "" if math.isnan(onset.input_frequency) else f" at {onset.input_frequency:.0f} Hz"
        first = min((entry for entry in onsets if entry[1] == index), key=lambda entry: entry[2].step)[2]
        resonance = region.name == "D" and onset.resonance
        some_before = first.step > data.experiments[index].first_step
        keep = (
            f": keep the steps before {first.step} (window)"
            if some_before
            else ", but no step is in it: check the units, and that positions count from the centre of the bearing"
        )
        return Finding(
            "region",
            Severity.WARNING,
            f"region {region.name} ({_MEANING[region.name]}) from step {onset.step} ({onset.time:.3f} s){frequency}"
            + "".join(f"; {what}" for what in judged.reservations),
            f"experiment {index}",
            f"no linear model holds outside region A{keep}"
            + (", or excite the resonance less" if resonance else ", or excite less"),
        )
    if frozen := frozen_positions(data):
        return Finding("region", Severity.INFO, "not checked: a dead or stuck sensor shows no region", frozen[0])
    if len(early) == len(data.experiments):
        return Finding("region", Severity.INFO, "not checked: the record is too short for B and C")
    others = f", but too short for B and C: experiments {', '.join(map(str, early))}" if early else ""
    if judged.complete():
        return Finding("region", Severity.INFO, f"region A throughout{others}")
    finding = "; ".join((f"{judged.absent()} found{others}", *judged.reservations))
    return Finding("region", Severity.INFO, finding)
