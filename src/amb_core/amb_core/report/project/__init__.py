"""A folder of work on a bearing: what is in it, what is stale, and which command comes next."""

from amb_core.report.project.items import Item, Kind, State
from amb_core.report.project.status import ProjectStatus, status_of

__all__ = ["Item", "Kind", "ProjectStatus", "State", "status_of"]
