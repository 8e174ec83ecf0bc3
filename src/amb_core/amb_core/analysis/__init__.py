"""Data of a recording for an analysis: its regions, data for identification, and the parameters of its loop."""

from amb_core.analysis.data_files import read_data
from amb_core.analysis.recorded_data import read_bag_data, recorded_data
from amb_core.analysis.recorded_loop import RecordedLoop, read_loop
from amb_core.analysis.recorded_regions import RecordedRegions, classify_run

__all__ = [
    "RecordedLoop",
    "RecordedRegions",
    "classify_run",
    "read_bag_data",
    "read_data",
    "read_loop",
    "recorded_data",
]
