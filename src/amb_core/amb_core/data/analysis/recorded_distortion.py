"""Distortion and coherence of a recording or a data file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from amb_core.data.analysis.file_recording import NO_STEPS, RUN, FileContent
from amb_core.data.analysis.recorded_data import recorded_data
from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.tones import cure_tones
from amb_core.ground.errors import AmbError, IdentificationError
from amb_core.loop.records import LoopRecord
from amb_core.recording import Recording
from amb_core.regions.distortion import Evidence, find_evidence

NO_REFERENCE = (
    "the data have no reference, which distortion is measured from; record telemetry, or name its columns with "
    "--reference"
)


def evidence_of_run(recording: Recording, run: int | None = None, first_step: int = -1, steps: int = 0) -> Evidence:
    """Distortion and coherence of a recording.

    Parameters
    ----------
    recording : Recording
        A bag, or a file as a recording of one run.
    run, first_step, steps : int, optional
        Samples of a bag that are used; by default the whole of its last run, and its last experiment for coherence.

    Returns
    -------
    Evidence
        Both measures, or the reason why one is missing.

    Raises
    ------
    BagError, IdentificationError
        If there are no such data.
    """
    if isinstance(recording.content, FileContent):
        if run not in (None, RUN) or first_step != -1 or steps:
            raise IdentificationError(f"data {recording.path}: {NO_STEPS}")
        return evidence_of_data(recording.content.data)
    data = recorded_data(recording, run, first_step, steps)
    if not recording.runs or first_step >= 0 or steps:
        return evidence_of_data(data)
    run = recording.runs[-1] if run is None else run
    whole, tones = _without_tones([recording.telemetry(run, *span) for span in recording.spans(run)])
    window, others = _without_tones(_records(data))
    return replace(find_evidence(whole, window), tones=tuple(sorted({*tones, *others})))


def evidence_or_reason(recording: Recording, run: int | None = None) -> Evidence:
    """As `evidence_of_run`; where the run does not hold the samples, the reason instead of an error."""
    try:
        return evidence_of_run(recording, run)
    except AmbError as problem:
        return Evidence(None, None, str(problem), str(problem))


def evidence_of_data(data: IdentificationData) -> Evidence:
    """Distortion and coherence of the experiments with a reference; without one, the reason."""
    records, tones = _without_tones(_records(data))
    return replace(find_evidence(records), tones=tones) if records else Evidence(None, None, NO_REFERENCE, NO_REFERENCE)


def _records(data: IdentificationData) -> Sequence[LoopRecord]:
    return [data.record(index) for index, item in enumerate(data.experiments) if item.reference is not None]


def _without_tones(records: Sequence[LoopRecord]) -> tuple[list[LoopRecord], tuple[float, ...]]:
    """Records without the tones that their references lack, which are no distortion, and the tones (Hz)."""
    calm, found = list[LoopRecord](), set[float]()
    for record in records:
        finite = all(np.isfinite(part).all() for part in (record.reference, record.position, record.current))
        cure = cure_tones(IdentificationData.from_record(record)) if finite else None
        calm.append(record if cure is None else cure.data.record())
        found |= set() if cure is None else set(cure.frequencies)
    return calm, tuple(sorted(found))
