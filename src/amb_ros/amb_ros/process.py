"""The life of a node process: start, spin, end cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import faulthandler
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
    SIGUSR1 writes the stacks of all threads to stderr, for a process that hangs.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads only take the cores from the other nodes
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    received: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        # Without a KeyboardInterrupt that could break off a callback anywhere: rclpy shuts its context down instead.
        signal.signal(number, lambda number, _frame: received.append(number))
    middleware.configure()
    rclpy.init(args=args)
    code = _run(factories, lambda: bool(received) or not rclpy.ok())
    _leave_threads_behind(code)
    return code


def _run(factories: Sequence[Callable[[], Node]], told_to_end: Callable[[], bool]) -> int:
    nodes: list[Node] = []
    try:
        executor = EventsExecutor()
        for factory in factories:
            if told_to_end():
                return 0
            nodes.append(factory())
            executor.add_node(nodes[-1])
        gc.freeze()  # what was made so far stays: the collector need not walk it in the middle of the loop
        spin(executor, told_to_end)
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        return 1
    except ExternalShutdownException:
        pass
    except Exception:
        if not told_to_end():
            raise
        # While starting: whatever was being made then fails without a context, in one way or another.
    finally:
        rclpy.try_shutdown()  # first: workers of the nodes then see that nobody waits for them any more
        for node in reversed(nodes):
            node.destroy_node()
    return 0


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> int:
    """`run_nodes` for one node: the body of every executable's `main`."""
    return run_nodes([factory], args)


def _leave_threads_behind(code: int) -> None:
    """End the process here and now if a thread still computes, which Python would wait for.

    Nobody wants its result any more, and what runs in compiled code cannot be broken off.
    """
    if any(not thread.daemon for thread in threading.enumerate() if thread is not threading.main_thread()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def spin(executor: Executor, told_to_end: Callable[[], bool]) -> None:
    """Spin until the process is told to end.

    The context alone does not show that. On a signal rclpy shuts down the contexts it knows from a thread of its own,
    and forgets them even where that fails, as it can while a node is being made: that context would live for ever.

    EventsExecutor hangs in `spin` and in waits without a time-out. Waiting for a future that never completes keeps the
    loop over the events inside the executor, which is faster than one `spin_once` an event.
    """
    while not told_to_end():
        executor.spin_until_future_complete(Future(), timeout_sec=SPIN_TIMEOUT)
