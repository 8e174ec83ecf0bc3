"""Lets a process leave the graph cleanly: it leaves nothing of its nodes behind, and does not hang.

Fast DDS 2.14 can loop for ever while a participant is destroyed. `DomainParticipant::set_listener` waits for a running
discovery callback, and repeatedly takes the mutex for which that callback waits. This occurs when the nodes of a graph
end together, since each node then receives discovery events about the others. On a single core the waiting thread runs
as soon as the mutex is released; on several cores it is too late every time.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path

from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node

from amb_core.loop.real_time import leave_real_time


def leave_graph(context: Context, executor: Executor, nodes: Sequence[Node]) -> None:
    """Shut a context down and destroy its nodes; it must be called in the thread that spins them."""
    leave_real_time()  # on one core a thread with priority would keep the others from running
    with _all_threads_on_one_core():
        context.try_shutdown()  # first: workers of the nodes then see that nobody waits for them any more
        executor.shutdown()  # releases the nodes: one with an open request would live as long as the process
        for node in reversed(nodes):
            for waitable in list(node.waitables):
                if isinstance(waitable, ActionClient):
                    waitable.destroy()  # rclpy's node does not, and lives on in the graph while they do
            node.destroy_node()


@contextlib.contextmanager
def _all_threads_on_one_core() -> Iterator[None]:
    threads = [int(task.name) for task in Path("/proc/self/task").iterdir()]
    allowed = {}
    for thread in threads:
        with contextlib.suppress(OSError):  # it has just ended
            allowed[thread] = os.sched_getaffinity(thread)
    cores = sorted(os.sched_getaffinity(0))
    one = frozenset({cores[os.getpid() % len(cores)]})
    _set_cores(dict.fromkeys(allowed, one))
    try:
        yield
    finally:
        _set_cores(allowed)


def _set_cores(allowed: Mapping[int, Set[int]]) -> None:
    for thread, cores in allowed.items():
        with contextlib.suppress(OSError):
            os.sched_setaffinity(thread, cores)
