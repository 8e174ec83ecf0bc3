"""The life of a node process: start, spin, end cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from threadpoolctl import threadpool_limits

from amb_core.errors import AmbError
from amb_ros import middleware

SPIN_TIMEOUT = 0.5  # s


def run_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Make the nodes, spin them on one EventsExecutor until SIGINT or SIGTERM, return the exit code of the process.

    A node that refuses its parameters raises an `AmbError`: its text goes to stderr as one line, and the code is 1.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads only take the cores from the other nodes
    told_to_end: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        # Without a KeyboardInterrupt that could break off a callback anywhere: rclpy shuts its context down instead.
        signal.signal(number, lambda number, _frame: told_to_end.append(number))
    middleware.configure()
    rclpy.init(args=args)
    if told_to_end:
        rclpy.try_shutdown()
    nodes: list[Node] = []
    try:
        executor = EventsExecutor()
        for factory in factories:
            nodes.append(factory())
            executor.add_node(nodes[-1])
        gc.freeze()  # what was made so far stays: the collector need not walk it in the middle of the loop
        spin(executor)
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        return 1
    except ExternalShutdownException:
        pass
    except Exception:
        if not told_to_end:
            raise
        # While starting: whatever was being made then fails without a context, in one way or another.
    finally:
        for node in reversed(nodes):
            node.destroy_node()
        rclpy.try_shutdown()
    _leave_threads_behind()
    return 0


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> int:
    """`run_nodes` for one node: the body of every executable's `main`."""
    return run_nodes([factory], args)


def _leave_threads_behind() -> None:
    """End the process here and now if a thread still computes, which Python would wait for.

    Nobody wants its result any more, and what runs in compiled code cannot be broken off.
    """
    if any(not thread.daemon for thread in threading.enumerate() if thread is not threading.main_thread()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def spin(executor: Executor) -> None:
    """Spin until the context is shut down.

    EventsExecutor hangs in `spin` and in waits without a time-out. Waiting for a future that never completes keeps the
    loop over the events inside the executor, which is faster than one `spin_once` an event.
    """
    while rclpy.ok():
        executor.spin_until_future_complete(Future(), timeout_sec=SPIN_TIMEOUT)
