"""The life of a node process: start, spin, end cleanly on SIGINT and SIGTERM."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from threadpoolctl import threadpool_limits

from amb_core.errors import AmbError

SPIN_TIMEOUT = 0.5  # s; EventsExecutor hangs without a timeout, and the loop must see a shutdown


def run_nodes(factories: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Make the nodes, spin them on one EventsExecutor until SIGINT or SIGTERM, return the exit code of the process.

    A node that refuses its parameters raises an `AmbError`: its text goes to stderr as one line, and the code is 1.
    """
    threadpool_limits(1)  # small matrices: more BLAS threads only take the cores from the other nodes
    rclpy.init(args=args)
    nodes: list[Node] = []
    try:
        executor = EventsExecutor()
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


def run_node(factory: Callable[[], Node], args: list[str] | None = None) -> int:
    """`run_nodes` for one node: the body of every executable's `main`."""
    return run_nodes([factory], args)


def spin(executor: rclpy.executors.Executor) -> None:
    """Spin until the context is shut down."""
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=SPIN_TIMEOUT)
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
