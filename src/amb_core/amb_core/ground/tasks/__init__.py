"""Long computations as tasks: they run on a cluster, and results are kept on disk, so no task runs twice."""

from amb_core.ground.files.cache_folder import cache_folder
from amb_core.ground.tasks.cache import ResultCache
from amb_core.ground.tasks.run import Request, run
from amb_core.ground.tasks.task import Task

__all__ = ["Request", "ResultCache", "Task", "cache_folder", "run"]
