"""Checks of data for identification: each a function with one finding, and all of them at once."""

from amb_core.data.experiments.checks.all_checks import check_data, check_recording
from amb_core.data.experiments.checks.distortion import check_distortion, evidence_of
from amb_core.data.experiments.checks.dynamics import check_delay, check_feedback
from amb_core.data.experiments.checks.excitation import (
    check_amount,
    check_excitation,
    check_inputs,
    highest_excited_order,
)
from amb_core.data.experiments.checks.region import check_region
from amb_core.data.experiments.checks.report import DataReport, Finding, Severity
from amb_core.data.experiments.checks.samples import (
    check_clipping,
    check_finite,
    check_gaps,
    check_offsets,
    check_sample_time,
)

__all__ = [
    "DataReport",
    "Finding",
    "Severity",
    "check_amount",
    "check_clipping",
    "check_data",
    "check_delay",
    "check_distortion",
    "check_excitation",
    "check_feedback",
    "check_finite",
    "check_gaps",
    "check_inputs",
    "check_offsets",
    "check_recording",
    "check_region",
    "check_sample_time",
    "evidence_of",
    "highest_excited_order",
]
