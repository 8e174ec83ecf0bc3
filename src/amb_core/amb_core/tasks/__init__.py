"""Long computations as tasks: run on a cluster, kept on disk as they finish, so that none is ever run twice."""

from amb_core.tasks.cache import ResultCache, cache_folder
from amb_core.tasks.run import Request, run
from amb_core.tasks.task import Task

__all__ = ["Request", "ResultCache", "Task", "cache_folder", "run"]
