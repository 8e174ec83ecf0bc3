"""Recordings: MCAP files in rosbag2 folders, written message by message and read as the library's own types.

Names load when they are first used: nodes need the messages in this folder, and not the libraries of bags.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from amb_core.recording.overview import BagOverview, read_overview
    from amb_core.recording.recorded_runs import RecordedRuns
    from amb_core.recording.recording import Recording
    from amb_core.recording.recovery import BagState, inspect_bag, recover_bag
    from amb_core.recording.run_overview import RunOverview, read_runs
    from amb_core.recording.step_audit import StepAudit, audit_steps
    from amb_core.recording.topic_info import TopicInfo
    from amb_core.recording.writer import BagWriter

__all__ = [
    "BagOverview",
    "BagState",
    "BagWriter",
    "RecordedRuns",
    "Recording",
    "RunOverview",
    "StepAudit",
    "TopicInfo",
    "audit_steps",
    "inspect_bag",
    "read_overview",
    "read_runs",
    "recover_bag",
]

_MODULES = {
    "BagOverview": "overview",
    "BagState": "recovery",
    "BagWriter": "writer",
    "RecordedRuns": "recorded_runs",
    "Recording": "recording",
    "RunOverview": "run_overview",
    "StepAudit": "step_audit",
    "TopicInfo": "topic_info",
    "audit_steps": "step_audit",
    "inspect_bag": "recovery",
    "read_overview": "overview",
    "read_runs": "run_overview",
    "recover_bag": "recovery",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
