"""Robustness of the closed loop of an identified model: margins, structured singular value, certificate.

>>> found = certify(model, controller, validation=validation, uncertainty=uncertainty)  # doctest: +SKIP
>>> found.certified, found.verdict  # doctest: +SKIP
"""

from amb_core.data.experiments import RecordedLoop as Recorded
from amb_core.linear.peak import Peak, peak_gain
from amb_core.robustness.assessment import Assessment, assess, assess_loop
from amb_core.robustness.certificate import Certificate, Check, certify
from amb_core.robustness.certificate_json import certificate_values
from amb_core.robustness.feedback import Feedback, feedback_of
from amb_core.robustness.from_data import certify_from_data
from amb_core.robustness.hashes import sha256_of, sha256_of_controller, sha256_of_data, sha256_of_model
from amb_core.robustness.margins import classical_margins, disk_margin_of_axis, disk_margins
from amb_core.robustness.measured import MeasuredSensitivity, measured_sensitivity
from amb_core.robustness.mu import Block, mu_peak
from amb_core.robustness.settings import RobustnessSettings, zone_of
from amb_core.robustness.sweep import SweepSettings

__all__ = [
    "Assessment",
    "Block",
    "Certificate",
    "Check",
    "Feedback",
    "MeasuredSensitivity",
    "Peak",
    "Recorded",
    "RobustnessSettings",
    "SweepSettings",
    "assess",
    "assess_loop",
    "certificate_values",
    "certify",
    "certify_from_data",
    "classical_margins",
    "disk_margin_of_axis",
    "disk_margins",
    "feedback_of",
    "measured_sensitivity",
    "mu_peak",
    "peak_gain",
    "sha256_of",
    "sha256_of_controller",
    "sha256_of_data",
    "sha256_of_model",
    "zone_of",
]
