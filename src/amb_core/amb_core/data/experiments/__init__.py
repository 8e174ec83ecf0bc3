"""Data for identification: experiments, their conditioning, checks and files."""

from amb_core.data.experiments.checks import DataReport, Finding, Severity, check_data
from amb_core.data.experiments.conditioning import advance_inputs, decimate, detrend, restore, split_at_invalid
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.description import DataDescription
from amb_core.data.experiments.drift import cure_drift, high_pass
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.experiments.files import write_data, written_data
from amb_core.data.experiments.gap import DataGap
from amb_core.data.experiments.interpret import DescribedData, SignalRow, describe_table, describe_tables
from amb_core.data.experiments.merging import merge
from amb_core.data.experiments.recorded_loop import RecordedLoop

__all__ = [
    "DataDescription",
    "DataGap",
    "DataReport",
    "DescribedData",
    "Experiment",
    "Finding",
    "IdentificationData",
    "RecordedLoop",
    "Severity",
    "SignalRow",
    "advance_inputs",
    "check_data",
    "cure_drift",
    "decimate",
    "describe_table",
    "describe_tables",
    "detrend",
    "high_pass",
    "merge",
    "restore",
    "split_at_invalid",
    "write_data",
    "written_data",
]
