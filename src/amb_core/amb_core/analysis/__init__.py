"""Data of a recording for an analysis: regions, distortion, data for identification, and parameters of the loop."""

from amb_core.analysis.data_files import read_data
from amb_core.analysis.own_files import OwnFile, read_own, read_own_recording
from amb_core.analysis.recorded_data import read_bag_data, recorded_data
from amb_core.analysis.recorded_distortion import evidence_of_data, evidence_of_run, read_evidence
from amb_core.analysis.recorded_loop import RecordedLoop, read_loop, recorded_controller
from amb_core.analysis.recorded_regions import RecordedRegions, classify_run

__all__ = [
    "OwnFile",
    "RecordedLoop",
    "RecordedRegions",
    "classify_run",
    "evidence_of_data",
    "evidence_of_run",
    "read_bag_data",
    "read_data",
    "read_evidence",
    "read_loop",
    "read_own",
    "read_own_recording",
    "recorded_controller",
    "recorded_data",
]
