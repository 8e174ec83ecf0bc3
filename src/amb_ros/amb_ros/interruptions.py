"""Ctrl-C and the other signals that end a program: which they are, and their delay during work that must be done."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def ending_signals() -> list[signal.Signals]:
    """Signals that end this process: `SIGNALS` without those that are ignored, as SIGHUP under nohup.

    SIGINT is one in every case: shells ignore it in what they start in the background.
    """
    return [number for number in SIGNALS if number is signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN]


@contextlib.contextmanager
def held_back() -> Iterator[list[int]]:
    """Delay SIGINT, SIGTERM and SIGHUP until the end of a block. The first one received is raised again there.

    The handler of a signal may raise an exception, such as KeyboardInterrupt, wherever the main thread is. In the
    destructors that rclpy's EventsExecutor runs, an exception aborts the whole process.

    Yields
    ------
    list of int
        The signals received so far. A block that handles them itself clears the list.
    """
    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # no other thread is interrupted
        handlers = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in handlers.items():
        if handler is not None:  # None: not a handler of Python, so it could not be restored
            signal.signal(number, lambda received, _frame: came.append(received))
    try:
        yield came
    finally:
        for number, handler in handlers.items():
            if handler is not None:
                signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
