"""Life cycle of a node process: start, spin, end cleanly on SIGINT, SIGTERM and SIGHUP."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import NoReturn

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_default_context
from threadpoolctl import threadpool_limits

from amb_core.ground.errors import AmbError, ParameterError, one_line
from amb_ros import middleware, shared_memory
from amb_ros.domain import require_domain
from amb_ros.interruptions import ending_signals
from amb_ros.leaving import leave_graph

SPIN_TIMEOUT = 0.1  # s


def run_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> NoReturn:
    """Make the nodes, spin them on one EventsExecutor until SIGINT, SIGTERM or SIGHUP, end the process.

    A node that refuses its parameters raises an `AmbError`: its text goes to stderr as one line, and the code is 1. So
    do arguments and a domain that ROS cannot use.
    SIGUSR1 writes the stacks of all threads to stderr, for a process that hangs.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads would only take cores from the other nodes
    faulthandler.register(signal.SIGUSR1, all_threads=True)
    end = _End()
    for number in ending_signals():
        signal.signal(number, lambda _number, _frame: end.ask_for())
    middleware.configure()
    shared_memory.remove_dead_segments()
    try:
        _join_graph(args)
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        sys.exit(1)
    code = _run(factories, end)
    shared_memory.remove(shared_memory.owned(os.getpid()))  # of a node that a thread still uses
    # Exit at once. Python would wait for threads whose results are no longer needed. Then destructors of libraries
    # would run while threads of other libraries are still running, which hung under load.
    for output in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):  # of a terminal that has been closed
            output.flush()
    os._exit(code)


def _join_graph(args: list[str] | None) -> None:
    """Initialise rclpy; ParameterError for a domain, a file or other arguments that it cannot use.

    rclpy would shut the context down in its own thread. While a node is being made that can fail without a message, and
    rclpy then has nothing left to shut down: no signal would end the process.
    """
    require_domain()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as problem:
        raise ParameterError(f"unknown arguments after --ros-args: {one_line(problem)}") from None
    except rclpy_implementation.RCLError as problem:
        text = _SOURCE_LINE.sub("", str(problem)).removeprefix("failed to initialize rcl: ")
        raise ParameterError(one_line(text)) from None


_SOURCE_LINE = re.compile(r"\s*, at /\S+:\d+")  # of rcl, which means nothing to a user


class _End:
    """The end of the process, requested by signals. A KeyboardInterrupt could interrupt a callback anywhere."""

    def __init__(self) -> None:
        self._asked_for = False
        self._reached: Future = Future()
        self.executor: Executor | None = None

    def __bool__(self) -> bool:
        return self._asked_for or not rclpy.ok()

    def ask_for(self) -> None:
        """Let `wait` return, also during a continuous stream of events."""
        if not self._asked_for:
            self._asked_for = True
            if self.executor is not None:
                self.executor.create_task(self._reached.set_result, None)

    def wait(self) -> None:
        """Spin until the end.

        EventsExecutor hangs in `spin` and in waits without a time-out. Waiting for a future keeps the event loop inside
        the executor, which is faster than one `spin_once` per event. The time-out lets Python handle signals.
        """
        while not self:
            assert self.executor is not None
            self.executor.spin_until_future_complete(self._reached, timeout_sec=SPIN_TIMEOUT)


def _run(factories: Sequence[Callable[[], Node]], end: _End) -> int:
    nodes: list[Node] = []
    code = 0
    executor = end.executor = EventsExecutor()
    try:
        for factory in factories:
            if end:
                break
            nodes.append(factory())
            executor.add_node(nodes[-1])
        gc.freeze()  # present objects stay: the collector need not traverse them while the loop runs
        end.wait()
    except ExternalShutdownException:
        pass
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        code = 1
    except Exception:
        traceback.print_exc()
        code = 1
    try:
        leave_graph(get_default_context(), executor, nodes, code)
    except Exception:
        traceback.print_exc()
        code = 1
    return code


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> NoReturn:
    """`run_nodes` for one node: the body of every executable's `main`."""
    run_nodes([factory], args)
