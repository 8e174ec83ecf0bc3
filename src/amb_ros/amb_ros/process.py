"""The life of a node process: start, spin, end cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import NoReturn

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_default_context
from threadpoolctl import threadpool_limits

from amb_core.errors import AmbError
from amb_ros import middleware
from amb_ros.leaving import leave_graph

SPIN_TIMEOUT = 0.1  # s


def run_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> NoReturn:
    """Make the nodes, spin them on one EventsExecutor until SIGINT or SIGTERM, end the process.

    A node that refuses its parameters raises an `AmbError`: its text goes to stderr as one line, and the code is 1.
    SIGUSR1 writes the stacks of all threads to stderr, for a process that hangs.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads only take the cores from the other nodes
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    end = _End()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: end.ask_for())
    middleware.configure()
    # rclpy would shut the context down from a thread of its own. While a node is being made that can fail, without a
    # word, and rclpy then knows nothing any more to shut down: no signal would end the process.
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    code = _run(factories, end)
    # Now: Python would wait for threads that still compute, whose results nobody wants any more, and then the
    # destructors of libraries run while threads of other libraries still do, which hung under load.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


class _End:
    """The end of the process, for which signals ask; a KeyboardInterrupt would break off a callback anywhere."""

    def __init__(self) -> None:
        self._asked_for = False
        self._reached: Future = Future()
        self.executor: Executor | None = None

    def __bool__(self) -> bool:
        return self._asked_for or not rclpy.ok()

    def ask_for(self) -> None:
        """Let `wait` return, also amid events that never cease."""
        if not self._asked_for:
            self._asked_for = True
            if self.executor is not None:
                self.executor.create_task(self._reached.set_result, None)

    def wait(self) -> None:
        """Spin until the end.

        EventsExecutor hangs in `spin` and in waits without a time-out. Waiting for a future keeps the loop over the
        events inside the executor, which is faster than one `spin_once` an event. The time-out lets Python see signals.
        """
        while not self:
            assert self.executor is not None
            self.executor.spin_until_future_complete(self._reached, timeout_sec=SPIN_TIMEOUT)


def _run(factories: Sequence[Callable[[], Node]], end: _End) -> int:
    nodes: list[Node] = []
    executor = end.executor = EventsExecutor()
    try:
        for factory in factories:
            if end:
                return 0
            nodes.append(factory())
            executor.add_node(nodes[-1])
        gc.freeze()  # what was made so far stays: the collector need not walk it in the middle of the loop
        end.wait()
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        return 1
    except ExternalShutdownException:
        pass
    finally:
        leave_graph(get_default_context(), executor, nodes)
    return 0


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> NoReturn:
    """`run_nodes` for one node: the body of every executable's `main`."""
    run_nodes([factory], args)
