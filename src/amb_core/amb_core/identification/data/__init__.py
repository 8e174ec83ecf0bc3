"""Data for identification: experiments, their conditioning, checks and files."""

from amb_core.identification.data.checks import DataReport, Finding, Severity, check_data
from amb_core.identification.data.conditioning import advance_inputs, decimate, detrend, restore, split_at_invalid
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.description import DataDescription
from amb_core.identification.data.drift import cure_drift, high_pass
from amb_core.identification.data.experiment import Experiment
from amb_core.identification.data.files import write_data, written_data
from amb_core.identification.data.gap import Gap
from amb_core.identification.data.interpret import DescribedData, SignalRow, describe_table
from amb_core.identification.data.merging import merge
from amb_core.identification.data.recorded_loop import RecordedLoop

__all__ = [
    "DataDescription",
    "DataReport",
    "DescribedData",
    "Experiment",
    "Finding",
    "Gap",
    "IdentificationData",
    "RecordedLoop",
    "Severity",
    "SignalRow",
    "advance_inputs",
    "check_data",
    "cure_drift",
    "decimate",
    "describe_table",
    "detrend",
    "high_pass",
    "merge",
    "restore",
    "split_at_invalid",
    "write_data",
    "written_data",
]
