"""How a process leaves the graph: nothing of its nodes stays behind, and it does not hang.

Fast DDS 2.14 can spin for ever while a participant is destroyed: `DomainParticipant::set_listener` waits for a callback
of discovery that is under way, and in doing so takes the mutex again at once which the callback is waiting for. It is
met where the nodes of a graph end together, since each then hears of the end of the others. On one core the thread that
waits for the mutex runs as soon as it is released; on several it comes too late every time.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path

from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node


def leave_graph(context: Context, executor: Executor, nodes: Sequence[Node]) -> None:
    """Shut a context down and destroy its nodes; it must be called in the thread that spins them."""
    with _all_threads_on_one_core():
        context.try_shutdown()  # first: workers of the nodes then see that nobody waits for them any more
        executor.shutdown()  # lets go of the nodes, or one with an open request would stay as long as the process
        for node in reversed(nodes):
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
