"""Regions of operation A to D (linear, drifting bias, slow oscillation, delevitated) from telemetry."""

from amb_core.regions.classifier import Classification, RegionClassifier, classify
from amb_core.regions.parameters import RegionParameters
from amb_core.regions.state import AxisState, Onset, Region, RegionState

__all__ = [
    "AxisState",
    "Classification",
    "Onset",
    "Region",
    "RegionClassifier",
    "RegionParameters",
    "RegionState",
    "classify",
]
