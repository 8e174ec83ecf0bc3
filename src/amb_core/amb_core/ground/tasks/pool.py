"""Tasks on a cluster: submitted, and collected as they finish."""

from __future__ import annotations

import contextlib
import logging
import queue
import time
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any, Generic

from amb_core.ground.errors import TaskError
from amb_core.ground.extras import extra
from amb_core.ground.tasks.cache import compute
from amb_core.ground.tasks.cluster import open_cluster
from amb_core.ground.tasks.task import R, Task

with extra("cluster"):
    from distributed import Client, Future, KilledWorker
    from distributed.comm import CommClosedError

START_TIMEOUT = 120.0  # s, ten times what a process takes to start on a busy machine
ABSENCE = 10.0  # s without workers after which a warning reports that an external scheduler has none
PREFIX = "amb-task-"  # of the names of the tasks in dask, before their keys

logger = logging.getLogger(__name__)


class TaskPool(Generic[R]):
    """Runs tasks with results of one type on a cluster, which exists from the first task until the pool is closed.

    Parameters
    ----------
    scheduler, workers : optional
        As for `open_cluster`.
    """

    def __init__(self, scheduler: str | None = None, workers: int | None = None) -> None:
        self._scheduler, self._workers = scheduler, workers
        self._resources = contextlib.ExitStack()
        self._client: Client | None = None
        self._last_seen = 0.0  # when there was a worker
        self._told = False  # whether a warning has been logged since that there is none
        self._waiting: dict[str, Future[Any]] = {}
        self._finished: queue.Queue[Future[Any]] = queue.Queue()

    def __enter__(self) -> TaskPool[R]:
        return self

    def __exit__(self, *problem: object) -> None:
        self._resources.close()

    def submit(self, task: Task[R], key: str, folder: Path, priority: int = 0) -> None:
        """Run a task as soon as a worker is free, those of higher priority first; see `compute` for the folder.

        Raises
        ------
        TaskError
            If this is the first task and the scheduler does not answer.
        """
        if self._client is None:
            self._client = self._open()
        future = self._client.submit(compute, task, key, folder, key=f"{PREFIX}{key}", priority=priority)
        self._waiting[key] = future
        future.add_done_callback(self._finished.put)

    def cancel(self, key: str) -> None:
        """Cancel a task if it has not begun yet, and forget its result."""
        self._waiting.pop(key).cancel()

    def next_finished(self, timeout: float) -> tuple[str, R | TaskError] | None:
        """Key of a finished task with its result, or with the error; None if nothing finished in time (s).

        Raises
        ------
        TaskError
            If the processes of the local cluster do not start.
        """
        try:
            future = self._finished.get(timeout=timeout)
        except queue.Empty:
            self._check_workers()
            return None
        key = str(future.key).removeprefix(PREFIX)
        if self._waiting.pop(key, None) is None:
            return None
        try:
            return key, future.result()
        except TaskError as problem:
            return key, problem
        except (ImportError, RuntimeError) as problem:
            if self._scheduler is None:
                raise
            reason = " ".join(str(problem).splitlines()[:1])
            return key, TaskError(
                f"the scheduler {self._scheduler} or its workers cannot run the tasks ({reason}); start them in an "
                "environment with this version of amb_core and of its libraries"
            )
        except KilledWorker:
            return key, TaskError("its worker died, and so did those that tried after it")
        except (CancelledError, CommClosedError, TimeoutError):
            return key, TaskError(f"the scheduler {self._scheduler or ''} is gone; finished results are kept")

    def _check_workers(self) -> None:
        """An external cluster may get workers later; a local one without workers has failed, restarts included."""
        if self._client is None or self._has_workers(self._client):
            self._last_seen, self._told = time.monotonic(), False
            return
        absent = time.monotonic() - self._last_seen
        if self._scheduler is None and absent > START_TIMEOUT:
            raise TaskError(
                f"no worker process has started within {START_TIMEOUT:g} s; `python -m dask worker` should run in this "
                "environment"
            )
        if self._scheduler is not None and absent > ABSENCE and not self._told:
            self._told = True
            logger.warning(
                "scheduler %s has had no workers for %g s; its work waits for one. Workers without this version of "
                "amb_core and its libraries end when they get work",
                self._scheduler,
                ABSENCE,
            )

    @staticmethod
    def _has_workers(client: Client) -> bool:
        try:
            return bool(client.scheduler_info()["workers"])
        except OSError:  # the scheduler is gone; the futures will report it
            return True

    def _open(self) -> Client:
        self._last_seen = time.monotonic()
        client = self._resources.enter_context(open_cluster(self._scheduler, self._workers))
        self._resources.callback(lambda: client.cancel(list(self._waiting.values())))
        return client
