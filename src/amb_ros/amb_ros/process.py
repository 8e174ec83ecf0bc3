"""The life of a node process: start, spin, end cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from threadpoolctl import threadpool_limits

from amb_core.errors import AmbError

SPIN_TIMEOUT = 0.5  # s; EventsExecutor hangs without a timeout, and the loop must see a shutdown


def run_nodes(
    factories: Sequence[Callable[[], Node]],
    args: list[str] | None = None,
    executor_type: Callable[[], Executor] = EventsExecutor,
) -> int:
    """Make the nodes, spin them on one executor until SIGINT or SIGTERM, return the exit code of the process.

    A node that refuses its parameters raises an `AmbError`: its text goes to stderr as one line, and the code is 1.

    Parameters
    ----------
    factories : sequence of callables
        Each makes a node.
    args : list of str, optional
        Command line; that of the process by default.
    executor_type : callable
        EventsExecutor is the fastest but does not await coroutines; nodes whose callbacks are coroutines need another.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads only take the cores from the other nodes
    rclpy.init(args=args)
    nodes: list[Node] = []
    try:
        executor = executor_type()
        for factory in factories:
            nodes.append(factory())
            executor.add_node(nodes[-1])
        spin(executor)
        return 0
    except AmbError as problem:
        print(f"[amb] {problem}", file=sys.stderr)
        return 1
    finally:
        for node in reversed(nodes):
            node.destroy_node()
        rclpy.try_shutdown()


def run_node(
    factory: Callable[[], Node], args: list[str] | None = None, executor_type: Callable[[], Executor] = EventsExecutor
) -> int:
    """`run_nodes` for one node: the body of every executable's `main`."""
    return run_nodes([factory], args, executor_type)


def spin(executor: Executor) -> None:
    """Spin until the context is shut down."""
    try:
        while rclpy.ok():
            # A future that never completes: the loop over the events then runs inside the executor, not here.
            executor.spin_until_future_complete(Future(), timeout_sec=SPIN_TIMEOUT)
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
