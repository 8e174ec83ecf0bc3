"""Runs tasks: stored results are read from disk, the others are computed on a cluster and stored."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic

from amb_core.ground.errors import TaskError
from amb_core.ground.tasks.cache import ResultCache
from amb_core.ground.tasks.task import R, Task

if TYPE_CHECKING:
    from amb_core.ground.tasks.pool import TaskPool

POLL = 0.1  # s; interval of the checks for a cancellation and for failed workers


def _always() -> bool:
    return True


@dataclass(frozen=True)
class Request(Generic[R]):
    """A task, and the use of its result.

    Attributes
    ----------
    task : Task
        What to run. Requests with the same task share one run.
    take : callable
        Called in the thread that runs the tasks, with the result or the error, and whether the result was stored
        before. Returns further requests.
    priority : int
        Those of higher priority run first.
    wanted : callable
        Whether the result is still needed; if no request for a task needs it, the task is not begun.
    reuse : bool
        Whether a stored result may be used.
    """

    task: Task[R]
    take: Callable[[R | TaskError, bool], Iterable[Request[R]]]
    priority: int = 0
    wanted: Callable[[], bool] = _always
    reuse: bool = True


def run(
    requests: Iterable[Request[R]],
    cache: ResultCache,
    scheduler: str | None = None,
    workers: int | None = None,
    *,
    cancelled: Callable[[], bool] | None = None,
    meanwhile: Callable[[], None] | None = None,
) -> None:
    """Run tasks and the further tasks that their results require.

    Parameters
    ----------
    requests : iterable of Request
        The first tasks.
    cache : ResultCache
        Where results are stored.
    scheduler : str, optional
        Address of a running dask scheduler (tls://host:port); by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core.
    cancelled : callable, optional
        Called ten times per second; once it returns true, this function returns. Results so far are stored. None if it
        cannot be cancelled.
    meanwhile : callable, optional
        Called once, while the cluster is busy with the first tasks. None for no call.

    Raises
    ------
    TaskError
        If the scheduler does not answer, or the local processes do not start.
    """
    from amb_core.ground.tasks.pool import TaskPool  # dask takes half a second to import

    with TaskPool[R](scheduler, workers) as pool:
        under_way = _UnderWay(pool, cache)
        under_way.ask(requests)
        if meanwhile is not None:
            meanwhile()
        while under_way.waiting and not (cancelled is not None and cancelled()):
            finished = pool.next_finished(POLL)
            if finished is not None:
                under_way.finish(*finished)


class _UnderWay(Generic[R]):
    """Requests whose tasks run, by key."""

    def __init__(self, pool: TaskPool[R], cache: ResultCache) -> None:
        self.waiting: dict[str, list[Request[R]]] = {}
        self._pool, self._cache = pool, cache

    def ask(self, requests: Iterable[Request[R]]) -> None:
        """Start tasks; those with stored results finish at once, and may request more."""
        asked = deque(requests)
        while asked:
            request = asked.popleft()
            if not request.wanted():
                continue
            key = request.task.key()
            if key in self.waiting:
                self.waiting[key].append(request)
                continue
            kept = self._cache.load(key, request.task) if request.reuse else None
            if kept is None:
                self._pool.submit(request.task, key, self._cache.folder, request.priority)
                self.waiting[key] = [request]
            else:
                asked.extend(request.take(kept, True))

    def finish(self, key: str, result: R | TaskError) -> None:
        """Deliver a result, cancel tasks that are no longer needed, and start those that it requires."""
        for request in self.waiting.pop(key):
            if not isinstance(result, TaskError):
                self._cache.ensure(key, request.task, result)
            more = request.take(result, False)
            self._cancel_unwanted()
            self.ask(more)

    def _cancel_unwanted(self) -> None:
        for key, requests in list(self.waiting.items()):
            requests[:] = [request for request in requests if request.wanted()]
            if not requests:
                del self.waiting[key]
                self._pool.cancel(key)
