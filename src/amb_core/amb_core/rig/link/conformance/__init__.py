"""Whether a port of the target keeps to AMB-UDP: `amb rig check`."""

from amb_core.rig.link.conformance.checks import CHECKS, Complaint, check_target
from amb_core.rig.link.conformance.exchange import Exchange

__all__ = ["CHECKS", "Complaint", "Exchange", "check_target"]
