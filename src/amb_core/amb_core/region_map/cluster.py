"""Where the sweeps run: a `dask.distributed` cluster of processes of our own, or one that is already there."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import sys
from collections.abc import Iterator

from distributed import Client, Scheduler, SpecCluster
from distributed.deploy.subprocess import SubprocessWorker

from amb_core.errors import RegionError

CONNECT_TIMEOUT = 3.0  # s, within which a scheduler answers on any network


class DetachedWorker(SubprocessWorker):
    """A worker as a fresh interpreter, which does not import the program that asks for the map.

    The processes of `LocalCluster` do, so that programs without a guard around their main part start themselves over
    and over. A session of its own keeps Ctrl-C in a terminal from the worker: the driver ends it.
    """

    async def _start(self) -> None:
        specification = json.dumps({"cls": self.worker_class, "opts": self.worker_kwargs})
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "dask", "spec", self.scheduler, "--spec", specification, start_new_session=True
        )


@contextlib.contextmanager
def open_cluster(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """A client of a cluster, closed on leaving; with it the cluster, if it is our own.

    Parameters
    ----------
    scheduler : str, optional
        Address of a running scheduler, tcp://host:port.
    workers : int, optional
        Processes of a cluster of our own, by default one for each core that this process may use.

    Raises
    ------
    RegionError
        If the scheduler does not answer.
    """
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            client = stack.enter_context(Client(stack.enter_context(_local_cluster(workers)), set_as_default=False))
        else:
            client = stack.enter_context(_connect(scheduler))
        yield client


def _connect(scheduler: str) -> Client:
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        return Client(scheduler, timeout=CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise RegionError(
            f"scheduler {scheduler}: does not answer ({type(problem).__name__}); allowed: the address of a running "
            "dask scheduler, as tcp://host:8786"
        ) from None


def _local_cluster(workers: int | None) -> SpecCluster:
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    options = {"nthreads": 1, "memory_limit": 0, "dashboard": False, "silence_logs": "CRITICAL", "host": "127.0.0.1"}
    worker = {"cls": DetachedWorker, "options": {"worker_kwargs": options}}
    return SpecCluster(
        workers={number: worker for number in range(count)},
        scheduler={"cls": Scheduler, "options": {"host": "127.0.0.1", "dashboard": False}},
        silence_logs=logging.CRITICAL,
    )
