"""Data for identification: experiments, their conditioning, checks and files."""

from amb_core.identification.data.checks import DataReport, Finding, Severity, check_data
from amb_core.identification.data.conditioning import advance_inputs, decimate, detrend, restore, split_at_invalid
from amb_core.identification.data.csv_files import read_csv
from amb_core.identification.data.dataset import Gap, IdentificationData, merge
from amb_core.identification.data.drift import cure_drift, high_pass
from amb_core.identification.data.experiment import Experiment
from amb_core.identification.data.files import READERS, write_data
from amb_core.identification.data.mat_files import read_mat
from amb_core.identification.data.npz_files import read_npz

__all__ = [
    "READERS",
    "DataReport",
    "Experiment",
    "Finding",
    "Gap",
    "IdentificationData",
    "Severity",
    "advance_inputs",
    "check_data",
    "cure_drift",
    "decimate",
    "detrend",
    "high_pass",
    "merge",
    "read_csv",
    "read_mat",
    "read_npz",
    "restore",
    "split_at_invalid",
    "write_data",
]
