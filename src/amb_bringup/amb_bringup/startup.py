"""Ctrl-C while modules are imported ends the process at once, with one line."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from amb_bringup.exit_codes import INTERRUPTED


@contextmanager
def leaving_at_once() -> Iterator[None]:
    """End the process on SIGINT instead of raising: an exception could be caught or printed by what is imported."""
    before = signal.signal(signal.SIGINT, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def leave(_number: int, _frame: FrameType | None) -> None:
    """End at once; at this time nothing is open."""
    os.write(2, b"amb: interrupted\n")
    os._exit(INTERRUPTED)
