"""Experiments over running speeds: one simulated run and identified model each, on a cluster, kept on disk."""

from amb_core.rig.running_speeds.campbell import IdentifiedCampbell, SpeedResult, identify_over_speeds
from amb_core.rig.running_speeds.settings import SpeedSettings
from amb_core.rig.running_speeds.speed_run import SpeedTask

__all__ = ["IdentifiedCampbell", "SpeedResult", "SpeedSettings", "SpeedTask", "identify_over_speeds"]
