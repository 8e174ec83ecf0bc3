"""Where tasks run: on a local `dask.distributed` cluster, or on one that is already running.

Whoever can connect to a scheduler or a worker runs code as the user who started it, also on a port of the loopback
interface, which other users of the machine reach. So the local cluster speaks TLS with a key of its own, which exists
in memory and in the environments of the workers, and both sides of every connection show it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import re
import sys
import time
from collections.abc import Iterator
from typing import Any

from amb_core.ground.errors import TaskError
from amb_core.ground.extras import extra

with extra("cluster"):
    import dask
    import psutil
    from distributed import Client, Scheduler, Security, SpecCluster
    from distributed.deploy.subprocess import SubprocessWorker

ADDRESS = re.compile(r"(tcp|tls|ws|wss)://\S+:\d+")
ENCRYPTED = ("tls://", "wss://")
TRACKER = "multiprocessing.resource_tracker"
TRACKER_TIMEOUT = 10.0  # s, within which one removes what its processes have left
CONNECT_TIMEOUT = 3.0  # s, within which a scheduler answers on any network
_LOGS = ("distributed", "distributed.client", "distributed.gc")  # dask gives each its own level

logger = logging.getLogger(__name__)


def check_address(scheduler: str) -> None:
    """Raise TaskError if a text is not the address of a scheduler."""
    if not ADDRESS.fullmatch(scheduler):
        raise TaskError(f"scheduler '{scheduler}' is no address; allowed: one like tls://host:8786")


@contextlib.contextmanager
def open_cluster(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """A client of a cluster, closed on exit together with the cluster if it is a local one.

    Parameters
    ----------
    scheduler : str, optional
        Address of a running scheduler, tls://host:port; by default processes on this machine. The key and certificates
        are those of dask's configuration (`distributed.comm.tls`). A warning is logged for one without TLS.
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
        resources.enter_context(_without_logs())
        if scheduler is None:
            cluster = resources.enter_context(_local_cluster(workers))
            yield resources.enter_context(Client(cluster, security=cluster.security, set_as_default=False))
        else:
            yield resources.enter_context(_connect(scheduler))


class DetachedWorker(SubprocessWorker):
    """A worker as a fresh interpreter, which does not import the program that submits the tasks.

    The processes of `LocalCluster` import it, so programs without a guard around their main part would start themselves
    again and again. The worker has its own session, so Ctrl-C in a terminal does not reach it; the driver ends it. If
    the driver is killed, the worker finishes its task, keeps the result, and ends. Its stderr is dropped: a problem of
    a task is returned as its result, and a worker that is ended during its start writes tracebacks of multiprocessing.

    Parameters
    ----------
    scheduler : str
        Its address.
    security : Security
        Key and certificates. They go to the worker by its environment, which other users cannot read; its arguments
        they could.
    **options
        As for `SubprocessWorker`.
    """

    def __init__(self, scheduler: str, security: Security, **options: Any) -> None:
        super().__init__(scheduler, **options)
        self._security = security

    async def _start(self) -> None:
        specification = json.dumps({"cls": self.worker_class, "opts": self.worker_kwargs})
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "dask", "spec", self.scheduler, "--spec", specification,
            stderr=asyncio.subprocess.DEVNULL, start_new_session=True,
            env={**os.environ, "DASK_LOGGING__DISTRIBUTED": "critical", **self._credentials()},
        )  # fmt: skip

    async def close(self) -> None:
        """End the worker at once. The one process that is not killed removes what the others leave in /dev/shm."""
        if self.process and self.process.returncode is None:
            ended, trackers = _with_trackers(self.process.pid)
            for process in ended:
                with contextlib.suppress(psutil.NoSuchProcess):
                    process.kill()
            await self.process.communicate()
            until = time.monotonic() + TRACKER_TIMEOUT
            while any(map(_runs, trackers)) and time.monotonic() < until:
                await asyncio.sleep(0.01)
        await super().close()

    def _credentials(self) -> dict[str, str]:
        worker = self._security.get_tls_config_for_role("worker")
        tls = {"CA_FILE": worker["ca_file"], "WORKER__KEY": worker["key"], "WORKER__CERT": worker["cert"]}
        return {
            "DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True",
            "DASK_DISTRIBUTED__WORKER__HTTP__ROUTES": "[]",
        } | {f"DASK_DISTRIBUTED__COMM__TLS__{name}": value for name, value in tls.items()}


def _with_trackers(pid: int) -> tuple[list[psutil.Process], list[psutil.Process]]:
    """A process and its descendants, and those of them that remove what Python's multiprocessing has opened."""
    try:
        nanny = psutil.Process(pid)
        descendants = nanny.children(recursive=True)
    except psutil.NoSuchProcess:
        return [], []
    trackers = [process for process in descendants if _is_tracker(process)]
    # The nanny first, or it starts a worker in place of the one that has ended
    return [nanny, *(process for process in descendants if process not in trackers)], trackers


def _is_tracker(process: psutil.Process) -> bool:
    try:
        return TRACKER in " ".join(process.cmdline())
    except psutil.NoSuchProcess:
        return False


def _runs(process: psutil.Process) -> bool:
    """Whether a process has not ended; an ended one may stay as a zombie where nobody asks for its exit code."""
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False


def _local_cluster(workers: int | None) -> SpecCluster:
    # Any free port for the pages of dask, because its usual one may be taken
    local = {"host": "127.0.0.1", "protocol": "tls", "dashboard": False, "dashboard_address": "127.0.0.1:0"}
    security = Security.temporary()
    options = {"security": security, "worker_kwargs": {**local, "nthreads": 1, "memory_limit": 0}}
    worker = {"cls": DetachedWorker, "options": options}
    # No task waits at a busy worker while another is idle: tasks run for seconds, moving one takes milliseconds.
    # Without routes the pages of dask, which anybody can read, are empty
    with dask.config.set({"distributed.scheduler.worker-saturation": 1.0, "distributed.scheduler.http.routes": []}):
        return SpecCluster(
            workers=dict.fromkeys(range(workers or len(os.sched_getaffinity(0))), worker),
            scheduler={"cls": Scheduler, "options": {**local, "security": security}},
            security=security,
        )


@contextlib.contextmanager
def _without_logs() -> Iterator[None]:
    """Keep dask's logs from the user, to the end of its event loop, which is later than that of a cluster.

    They tell of a lost scheduler, of connections that are closed and, as critical, of a client that is gone: ours, by
    Ctrl-C; each with a traceback. Problems that the user can do something about are errors and warnings of ours.
    """
    logs = [logging.getLogger(name) for name in _LOGS]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


@contextlib.contextmanager
def _connect(scheduler: str) -> Iterator[Client]:
    if not scheduler.startswith(ENCRYPTED):
        logger.warning(
            "scheduler %s is not encrypted: whoever reaches its port runs code as you, and as its workers; start it "
            "with --protocol tls",
            scheduler,
        )
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError):
        raise TaskError(
            f"scheduler {scheduler} does not answer within {CONNECT_TIMEOUT:g} s; is it running, with the same "
            "version of dask, and with the certificate of your configuration of dask (distributed.comm.tls)?"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            logger.warning("scheduler %s has no workers yet; its work waits for one", scheduler)
        yield client
