"""Regions of operation A to D (linear, drifting bias, slow oscillation, delevitated) from telemetry."""

from amb_core.regions.classification import Classification, classify
from amb_core.regions.classifier import RegionClassifier
from amb_core.regions.judged import Judged
from amb_core.regions.layout import Layout, MonitoredBearing, layout_of, layout_without_machine
from amb_core.regions.parameters import RegionParameters
from amb_core.regions.state import AxisState, BearingState, Onset, Region, RegionState

__all__ = [
    "AxisState",
    "BearingState",
    "Classification",
    "Judged",
    "Layout",
    "MonitoredBearing",
    "Onset",
    "Region",
    "RegionClassifier",
    "RegionParameters",
    "RegionState",
    "classify",
    "layout_of",
    "layout_without_machine",
]
