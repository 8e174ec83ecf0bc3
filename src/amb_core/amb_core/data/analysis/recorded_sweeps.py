"""The bag of a swept sine with the dwells that followed it: one recording, whatever number of runs it took."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from amb_core.data.analysis.recorded_data import recorded_data
from amb_core.data.experiments import RecordedLoop
from amb_core.ground.files.regular_files import is_folder
from amb_core.recording import Recording

DWELLS = "dwells"
"""Folder in that of the first sweep, with the bag of the dwells."""


def with_dwells(path: str | Path, sweep: RecordedLoop) -> RecordedLoop:
    """The data of a first sweep with those of its dwells; as they are if there are none.

    Parameters
    ----------
    path : path
        Bag of the first sweep.
    sweep : RecordedLoop
        What was read of it.

    Raises
    ------
    BagError, IdentificationError
        If the dwells cannot be read.
    """
    folder = Path(path) / DWELLS
    if not is_folder(folder):
        return sweep
    recording = Recording.read(folder)
    experiments = list(sweep.data.experiments)
    for run in recording.runs:
        for one in recording.excitations(run):
            if one.accepted and one.steps:
                experiments += recorded_data(recording, run, one.first_step, one.steps).experiments
    return replace(sweep, data=replace(sweep.data, experiments=tuple(experiments)))
