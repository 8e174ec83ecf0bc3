"""Where tasks run: on a local `dask.distributed` cluster, or on one that is already running."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import re
import sys
from collections.abc import Iterator

from amb_core.errors import TaskError
from amb_core.extras import extra

with extra("cluster"):
    import dask
    from distributed import Client, Scheduler, SpecCluster
    from distributed.deploy.subprocess import SubprocessWorker

ADDRESS = re.compile(r"(tcp|tls|ws|wss)://\S+:\d+")
CONNECT_TIMEOUT = 3.0  # s, within which a scheduler answers on any network

logger = logging.getLogger(__name__)


def check_address(scheduler: str) -> None:
    """Raise TaskError if a text is not the address of a scheduler."""
    if not ADDRESS.fullmatch(scheduler):
        raise TaskError(f"scheduler '{scheduler}' is no address; allowed: one like tcp://host:8786")


@contextlib.contextmanager
def open_cluster(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """A client of a cluster, closed on exit together with the cluster if it is a local one.

    Parameters
    ----------
    scheduler : str, optional
        Address of a running scheduler, tcp://host:port; by default processes on this machine.
    workers : int, optional
        Number of these processes, by default one for each core that this process may use.

    Raises
    ------
    TaskError
        If the scheduler does not answer or is not an address, or the number of workers is not allowed.
    """
    if workers is not None and workers < 1:
        raise TaskError(f"workers = {workers} is not allowed; allowed: 1 or more")
    if scheduler is not None:
        check_address(scheduler)
    if workers is not None and scheduler is not None:
        raise TaskError(
            f"workers = {workers} cannot be combined with scheduler {scheduler}, which has its own workers; "
            "omit workers"
        )
    with contextlib.ExitStack() as resources:
        if scheduler is None:
            cluster = resources.enter_context(_local_cluster(workers))
            yield resources.enter_context(Client(cluster, set_as_default=False))
        else:
            yield resources.enter_context(_connect(scheduler))


class DetachedWorker(SubprocessWorker):
    """A worker as a fresh interpreter, which does not import the program that submits the tasks.

    The processes of `LocalCluster` import it, so programs without a guard around their main part would start themselves
    again and again. The worker has its own session, so Ctrl-C in a terminal does not reach it; the driver ends it. If
    the driver is killed, the worker finishes its task, keeps the result, and ends. Its stderr is dropped: a problem of
    a task is returned as its result, and a worker that is ended during its start writes tracebacks of multiprocessing.
    """

    async def _start(self) -> None:
        specification = json.dumps({"cls": self.worker_class, "opts": self.worker_kwargs})
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "dask", "spec", self.scheduler, "--spec", specification,
            stderr=asyncio.subprocess.DEVNULL, start_new_session=True,
            env={**os.environ, "DASK_LOGGING__DISTRIBUTED": "critical"},
        )  # fmt: skip


def _local_cluster(workers: int | None) -> SpecCluster:
    # Any free port for the pages of dask, because its usual one may be taken
    local = {"host": "127.0.0.1", "dashboard": False, "dashboard_address": "127.0.0.1:0"}
    worker = {"cls": DetachedWorker, "options": {"worker_kwargs": {**local, "nthreads": 1, "memory_limit": 0}}}
    # No task waits at a busy worker while another is idle: tasks run for seconds, moving one takes milliseconds
    with dask.config.set({"distributed.scheduler.worker-saturation": 1.0}):
        return SpecCluster(
            workers=dict.fromkeys(range(workers or len(os.sched_getaffinity(0))), worker),
            scheduler={"cls": Scheduler, "options": local},
            silence_logs=logging.CRITICAL,
        )


@contextlib.contextmanager
def _connect(scheduler: str) -> Iterator[Client]:
    # dask gives the second logger its own level, and logs there a lost scheduler with a traceback
    logs = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        try:
            client = Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, ValueError):
            raise TaskError(
                f"scheduler {scheduler} does not answer within {CONNECT_TIMEOUT:g} s; is it running, and with the same "
                "version of dask?"
            ) from None
        with client:
            if not client.scheduler_info()["workers"]:
                logger.warning("scheduler %s has no workers yet; its work waits for one", scheduler)
            yield client
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
