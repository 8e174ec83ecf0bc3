"""Recordings: MCAP files in rosbag2 folders, written message by message and read as the library's own types."""

from amb_core.recording.content import TopicInfo
from amb_core.recording.recording import Recording
from amb_core.recording.recovery import BagState, inspect_bag, recover_bag
from amb_core.recording.step_audit import StepAudit, audit_steps
from amb_core.recording.writer import BagWriter

__all__ = [
    "BagState",
    "BagWriter",
    "Recording",
    "StepAudit",
    "TopicInfo",
    "audit_steps",
    "inspect_bag",
    "recover_bag",
]
