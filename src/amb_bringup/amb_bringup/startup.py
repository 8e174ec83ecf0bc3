"""Ctrl-C or another signal that ends a program, while modules are imported: it ends at once, with one line."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from amb_bringup.exit_codes import INTERRUPTED
from amb_ros.interruptions import ending_signals


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the process on a signal instead of raising: an exception could be caught or printed by what is imported."""
    before = {number: signal.signal(number, leave) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def leave(_number: int, _frame: FrameType | None) -> None:
    """End at once; at this time nothing is open."""
    os.write(2, b"amb: interrupted\n")
    os._exit(INTERRUPTED)
