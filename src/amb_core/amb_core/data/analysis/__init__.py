"""Data of a recording for an analysis: regions, distortion, data for identification, and parameters of the loop."""

from amb_core.data.analysis.reading import read, read_recording, recorded_controller
from amb_core.data.analysis.recorded_data import recorded_data
from amb_core.data.analysis.recorded_distortion import evidence_of_run
from amb_core.data.analysis.recorded_regions import RecordedRegions, classify_run
from amb_core.data.experiments import RecordedLoop

__all__ = [
    "RecordedLoop",
    "RecordedRegions",
    "classify_run",
    "evidence_of_run",
    "read",
    "read_recording",
    "recorded_controller",
    "recorded_data",
]
