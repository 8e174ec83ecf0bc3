"""The classification of a record as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RegionError
from amb_core.ground.given_values import numbers, require_kind
from amb_core.ground.parameters import given_set
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.regions.classifier import RegionClassifier
from amb_core.regions.judged import Judged
from amb_core.regions.layout import layout_of, layout_without_machine
from amb_core.regions.parameters import RegionParameters
from amb_core.regions.state import AxisState, Onset, Region, RegionState


@dataclass(frozen=True)
class Classification:
    """Regions of a whole record.

    Attributes
    ----------
    states : list of RegionState
        One per update.
    onsets : dict of Region to Onset
        First onset of B, C and D of the rotor; regions that did not occur, or only after a higher one, are missing.
    axis_onsets : dict of str to dict
        By name of the axis: first evidence of each region, also after a higher one.
    judged : Judged
        What could be judged at all: the clearance may not be known, and B is not judged while the loop resonates.
    """

    states: list[RegionState]
    onsets: dict[Region, Onset]
    axis_onsets: dict[str, dict[Region, Onset]]
    judged: Judged


def classify(
    record: LoopRecord,
    parameters: RegionParameters | None = None,
    *,
    machine: Machine | None = None,
    clearance: Mapping[str, float] | None = None,
    delevitated: bool = False,
    frequency: NDArray[np.float64] | None = None,
) -> Classification:
    """Classify a record as the streaming classifier does.

    Parameters
    ----------
    record : LoopRecord
        Samples of a loop.
    parameters : RegionParameters, optional
        Thresholds and times. The defaults if None.
    machine : Machine, optional
        The machine, if it is known: its bearings and their clearances. None otherwise: see `layout_without_machine`.
    clearance : mapping of str to float, optional
        Without a machine, by axis: displacement from the centre at which the rotor touches its bearing (m). None if it
        is not known; D is then not judged, unless `delevitated` says it.
    delevitated : bool, optional
        Whether the record ends because the rotor delevitated in its last step (its position there is not recorded).
    frequency : ndarray, shape (steps,), optional
        Frequency of the input at each sample (Hz), if it is known. Otherwise it is estimated from the reference, which
        works for a sweep from about 25 Hz onwards.

    Returns
    -------
    Classification
        Region of every update, with the onsets.

    Raises
    ------
    RegionError
        If `frequency` has another length, a sample is not finite, the axes are not those of the machine, or the sample
        time is too long; see `RegionParameters.for_sample_time`.
    """
    require_kind("record", record, LoopRecord, "a LoopRecord", RegionError)
    parameters = given_set(RegionParameters, "parameters", parameters, RegionError)
    require_kind("machine", machine, (Machine, type(None)), "a Machine, or None", RegionError)
    if frequency is not None:
        frequency = numbers("frequency", frequency, RegionError)
    if frequency is not None and frequency.shape != (record.steps,):
        raise RegionError(f"frequency has shape {frequency.shape}; the record has {record.steps} samples")
    layout = layout_without_machine(record.axes, clearance) if machine is None else layout_of(machine)
    classifier = RegionClassifier(parameters, record.sample_time, layout)
    states = classifier.feed(record)
    if delevitated:
        states.append(classifier.delevitate())
    axes = {name: _first_onsets([state.axes[column] for state in states]) for column, name in enumerate(layout.axes)}
    if frequency is not None:
        for onsets in axes.values():
            for region, onset in onsets.items():
                row = min(onset.step - record.first_step, record.steps - 1)
                onsets[region] = replace(onset, input_frequency=float(frequency[row]))
    rotor: dict[Region, Onset] = {}
    for region in (Region.B, Region.C, Region.D):
        first_of_axes = [onsets[region] for onsets in axes.values() if region in onsets]
        if first_of_axes:
            rotor[region] = min(first_of_axes, key=lambda onset: onset.step)
    return Classification(states, in_order(rotor), axes, classifier.judged)


def _first_onsets(states: list[AxisState]) -> dict[Region, Onset]:
    onsets: dict[Region, Onset] = {}
    for state in states:
        contact = state.since if state.region is Region.D else None
        for region, onset in ((Region.B, state.drift), (Region.C, state.oscillation), (Region.D, contact)):
            if onset is not None:
                onsets.setdefault(region, onset)
    return dict(sorted(onsets.items()))


def in_order(onsets: dict[Region, Onset]) -> dict[Region, Onset]:
    """The onsets without those that come after the onset of a higher region."""
    return {
        region: onset
        for region, onset in sorted(onsets.items())
        if all(onset.step <= onsets[higher].step for higher in onsets if higher > region)
    }
