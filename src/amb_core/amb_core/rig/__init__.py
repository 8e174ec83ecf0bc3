"""A rig behind a real-time target: its telemetry as runs, its trips, and the protection of its host's side."""

from amb_core.rig.protection import ExcitationProtection, ProtectionParameters
from amb_core.rig.runs import Runs, RunSamples
from amb_core.rig.trips import BridgeTrip, TripLog, describe

__all__ = ["BridgeTrip", "ExcitationProtection", "ProtectionParameters", "RunSamples", "Runs", "TripLog", "describe"]
