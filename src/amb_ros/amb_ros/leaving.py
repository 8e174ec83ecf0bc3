"""Lets a process leave the graph cleanly: it leaves nothing of its nodes behind, and does not hang.

The one known cause of a hang is removed by `overflowed_wait`. Limits stand behind it, in case there are others. A hang
in the middleware holds the GIL, so no limit may depend on Python. A process of the workbench ends in time by a timer of
the C library, set when its nodes have closed their files. A crash of the middleware from then on harms nobody, and
counts as a hang. A process of the user is never ended: there the middleware's part of a node is destroyed in a thread
without the GIL.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import signal
import threading
import time
import warnings
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.node import Node

from amb_core.loop.real_time import leave_real_time

LIMIT = 4.5  # s; an idle machine needs a hundredth of it
_SIGEV_THREAD = 2  # a timer of this kind calls a function in a new thread
_CRASHES = (signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT)


@runtime_checkable
class Finishing(Protocol):
    """A node that has something to close, such as a bag or a rig."""

    def finish(self) -> None:
        """Close it. Called once, when no callback runs any more."""


@runtime_checkable
class Holding(Protocol):
    """A node that holds something that it cannot let go without others: a rotor in a loop that another one closes, or
    samples that others have not got yet.
    """

    def let_go(self) -> None:
        """Let it go. Called once, while the graph is still there; it must not raise."""


def leave_graph(context: Context, executor: Executor, nodes: Sequence[Node], code: int | None = None) -> None:
    """Shut a context down, let its nodes finish and destroy them; it must be called in the thread that spins them.

    Parameters
    ----------
    context, executor, nodes
        What is left.
    code : int, optional
        Exit code of a process that ends after this call. Such a process also ends if the call does not return.
    """
    leave_real_time()  # on one core a thread with priority would keep the others from running
    for node in nodes:
        if isinstance(node, Holding):
            node.let_go()
    context.try_shutdown()  # first: workers of the nodes then see that nobody waits for them any more
    executor.shutdown()  # releases the nodes: one with an open request would live as long as the process
    with contextlib.ExitStack() as steps:  # each in every case, the last one first
        for node in nodes:
            steps.callback(_destroy, node)
        if code is not None:
            steps.push(lambda kind, *_: end_within(LIMIT, code if kind is None else 1))
        for node in nodes:
            if isinstance(node, Finishing):
                steps.callback(node.finish)


def _destroy(node: Node) -> None:
    for waitable in list(node.waitables):
        if isinstance(waitable, ActionClient):
            waitable.destroy()  # rclpy's node does not, and lives on in the graph while they do
    node.destroy_node()


def leave_graph_and_go_on(context: Context, executor: Executor, node: Node) -> None:
    """As `leave_graph`, in a process that goes on in every case; the node must have no publisher to /rosout.

    If the middleware hangs, this ends with a warning, and the node stays in the graph as long as the process.
    """
    handle = node.handle
    handle.__enter__()  # until its counterpart the node keeps its part in the middleware
    leave_graph(context, executor, [node])
    # rclpy would call this with the GIL held. Its own call, at last, has nothing left to do.
    end = ctypes.CDLL("librcl.so").rcl_node_fini
    thread = threading.Thread(target=end, args=(ctypes.c_void_p(handle.pointer),), daemon=True)
    thread.start()
    thread.join(LIMIT)
    if thread.is_alive():
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(handle))  # for ever
        libc = ctypes.CDLL(None)
        libc.on_exit(libc._exit, None)  # with its exit code: destructors of the middleware would wait for the thread
        warnings.warn("the middleware hangs while it leaves the graph; this process goes on", stacklevel=2)
    else:
        handle.__exit__(None, None, None)


class _Event(ctypes.Structure):
    """`struct sigevent` of Linux."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("rest", ctypes.c_char * 32),
    )


class _Setting(ctypes.Structure):
    """`struct itimerspec`: interval and first time, each in seconds and nanoseconds."""

    _fields_ = (("interval", ctypes.c_long * 2), ("first", ctypes.c_long * 2))


def end_within(limit: float, code: int) -> None:
    """End the process after a time without any help of Python; a second earlier its stacks go to stderr.

    A thread that crashes until then is held where it is, so the process ends with the same code.

    Parameters
    ----------
    limit : float
        The time, more than one second (s).
    code : int
        The exit code.
    """
    libc = ctypes.CDLL(None)
    end = ctypes.cast(libc._exit, ctypes.c_void_p)
    event, timer = _Event(value=code, kind=_SIGEV_THREAD, function=end), ctypes.c_void_p()
    setting = _Setting(first=(int(limit), int(limit % 1 * 1e9)))
    libc.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    libc.timer_settime(timer, 0, ctypes.byref(setting), None)
    for crash in _CRASHES:
        libc.signal(crash, ctypes.cast(libc.pause, ctypes.c_void_p))
    faulthandler.dump_traceback_later(limit - 1.0)
