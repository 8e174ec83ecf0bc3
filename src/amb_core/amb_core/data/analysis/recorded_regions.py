"""The regions of a recorded run: its telemetry classified, with further information from the bag."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.data.analysis.recorded_clearance import MONITOR_NODE, recorded_clearance
from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks.faults import frozen_positions
from amb_core.ground.errors import BagError, RegionError
from amb_core.ground.given_values import kind_of, whole_number
from amb_core.ground.parameters import part_of
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.regions import Classification, Judged, Onset, Region, RegionParameters, classify
from amb_core.regions.classification import in_order
from amb_core.regions.stretches import stretches

if TYPE_CHECKING:
    from amb_core.recording import Recording


@dataclass(frozen=True)
class RecordedRegions:
    """A recorded run and its regions.

    Attributes
    ----------
    run : int
        The run.
    record : LoopRecord
        From its first to its last step; NaN where there is no telemetry.
    frequency : ndarray, shape (steps,), or None
        Input frequency of the excitations in the bag (Hz), NaN where there is none; None if there is none at all.
    classification : Classification
        Of all parts between gaps; the onsets are the first ones of the run.
    missing : list of (int, int)
        Spans (first step, step after the last) without telemetry.
    gaps : list of (int, int)
        These, and spans with samples that are not finite; the classification restarts after each.
    frozen : list of str
        Positions that keep one value while their axis moves, with the steps: a dead or stuck sensor shows no region.
    delevitated : bool
        Whether the simulator ended the run because the rotor delevitated.
    parameters : RegionParameters
        Thresholds and times: those of the recorded region monitor, otherwise defaults; with the clearance of radial
        bearings that a user gives for the recording.
    longer : float
        How many times as long the times are, for the sake of the sample time (-).
    """

    run: int
    record: LoopRecord
    frequency: NDArray[np.float64] | None
    classification: Classification
    missing: list[tuple[int, int]]
    gaps: list[tuple[int, int]]
    frozen: list[str]
    delevitated: bool
    parameters: RegionParameters
    longer: float = 1.0

    @property
    def frozen_problem(self) -> str:
        """What the frozen positions mean, in words; empty without any."""
        if not self.frozen:
            return ""
        places = ", ".join(self.frozen)
        return f"position {places}: unchanged while its axis moves; a dead or stuck sensor shows no region"

    @property
    def centre_problem(self) -> str:
        """What region D throughout may mean, in words; empty otherwise."""
        parts = stretches(self.classification.states)
        if not parts or any(part.region is not Region.D for part in parts):
            return ""
        return "the position is at or beyond the clearance throughout; does it count from the centre of the bearing?"


def classify_run(recording: Recording, run: int | None = None) -> RecordedRegions:
    """Classify the telemetry of a run, by default the last one of a recording.

    Parameters
    ----------
    recording : Recording
        A bag, or a file as a recording of one run.
    run : int, optional
        Number of the run; by default the last one.

    Returns
    -------
    RecordedRegions
        Regions over time, with the samples.

    Raises
    ------
    BagError
        If the bag has no telemetry, or none of this run.
    RegionError
        If no sample is finite, or the sample time does not fit the thresholds.
    """
    if not hasattr(recording, "spans"):  # a bag or a file
        allowed = "what read_recording or Recording.read returns"
        raise BagError(f"recording: {kind_of(recording)} is not allowed; allowed: {allowed}")
    if run is not None:
        run = whole_number("run", run, BagError)
    spans = recording.spans(run) if recording.runs else []
    if not spans:
        recording.telemetry(run)  # its error lists what is available
    run = recording.runs[-1] if run is None else run
    first_step, stop = spans[0][0], spans[-1][1]
    frequency = recording.input_frequency(first_step, stop, run)
    ended = recording.delevitation(run)
    records = [recording.telemetry(run, start, end) for start, end in spans]
    machine = _machine(recording, records[0].axes, run)
    wanted = _parameters(recording, run)
    clearance = recorded_clearance(recording, records[0].axes, run)
    usable = [part for record in records for part in _finite_parts(record)]
    try:
        parameters = wanted.for_sample_time(records[0].sample_time)
        parts = [
            classify(
                part,
                parameters,
                machine=machine,
                clearance=clearance,
                delevitated=ended == part.first_step + part.steps,
            )
            for part in usable or records
        ]
    except RegionError as problem:
        raise RegionError(f"{recording.path}, run {run}: {problem}") from None
    return RecordedRegions(
        run,
        _joined(records),
        frequency if np.isfinite(frequency).any() else None,
        _joined_classification(parts, first_step, frequency),
        _between(spans, first_step, stop),
        _between([(part.first_step, part.first_step + part.steps) for part in usable], first_step, stop),
        [place for part in usable for place in frozen_positions(IdentificationData.from_record(part))],
        ended is not None,
        parameters,
        parameters.update_interval / wanted.update_interval,
    )


def _finite_parts(record: LoopRecord) -> list[LoopRecord]:
    """A record without the samples of reference and position that are not finite."""
    finite = np.isfinite(record.reference).all(axis=1) & np.isfinite(record.position).all(axis=1)
    edges = np.flatnonzero(np.diff(finite, prepend=False, append=False))
    starts, stops = edges[::2].tolist(), edges[1::2].tolist()
    return [record.window(record.first_step + start, stop - start) for start, stop in zip(starts, stops, strict=True)]


def _between(spans: Sequence[tuple[int, int]], first_step: int, stop: int) -> list[tuple[int, int]]:
    """The gaps between spans of steps, from one step to another."""
    ends = [(first_step, first_step), *spans, (stop, stop)]
    return [(end, start) for (_, end), (start, _) in pairwise(ends) if start > end]


def _machine(recording: Recording, axes: tuple[str, ...], run: int) -> Machine | None:
    """The recorded machine, if the run has its axes."""
    machine = recording.machine(run)
    return machine if machine is not None and machine.axis_names == axes else None


def _parameters(recording: Recording, run: int) -> RegionParameters:
    parameters = part_of(RegionParameters, recording.parameters_of(MONITOR_NODE, run) or {})
    if recording.clearance is None:
        return parameters
    return parameters.model_copy(update={"backup_bearing_radius": recording.clearance})


def _joined(records: Sequence[LoopRecord]) -> LoopRecord:
    """One record from the first step to the last, NaN where there is none."""
    first, last = records[0], records[-1]
    signals = np.full((3, last.first_step + last.steps - first.first_step, len(first.axes)), np.nan)
    for record in records:
        start = record.first_step - first.first_step
        signals[:, start : start + record.steps] = record.reference, record.position, record.current
    reference, position, current = signals
    return LoopRecord(first.first_step, first.sample_time, reference, position, current, first.axes)


def _joined_classification(
    parts: Sequence[Classification], first_step: int, frequency: NDArray[np.float64]
) -> Classification:
    """All states, and the first onset of each region; with the known input frequency, if any.

    As in one part, a region of the rotor that occurs only after a higher one is missing.
    """

    def first(onsets: Iterable[dict[Region, Onset]]) -> dict[Region, Onset]:
        joined: dict[Region, Onset] = {}
        for part in onsets:
            for region, onset in part.items():
                row = min(onset.step - first_step, len(frequency) - 1)
                known = float(frequency[row]) if np.isfinite(frequency[row]) else onset.input_frequency
                joined.setdefault(region, replace(onset, input_frequency=known))
        return dict(sorted(joined.items()))

    return Classification(
        [state for part in parts for state in part.states],
        in_order(first(part.onsets for part in parts)),
        {axis: first(part.axis_onsets[axis] for part in parts) for axis in parts[0].axis_onsets},
        Judged.joined([part.judged for part in parts]),
    )
