"""Slow drift of the outputs, such as that of a sensor that warms up: found in the data, and removed from them."""

from amb_core.data.experiments.drift.cure import DriftCure, DriftOption, cure_drift
from amb_core.data.experiments.drift.find import Drift, find_drift
from amb_core.data.experiments.drift.prefilter import high_pass

__all__ = ["Drift", "DriftCure", "DriftOption", "cure_drift", "find_drift", "high_pass"]
