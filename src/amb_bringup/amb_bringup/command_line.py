"""Where `amb` starts: it imports no command, so that Ctrl-C is handled before that is done."""

from __future__ import annotations

import os
import signal
from types import FrameType

from amb_bringup.exit_codes import INTERRUPTED


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    signal.signal(signal.SIGINT, _leave)
    from amb_bringup.cli import main as run

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a command may have something to close
    try:
        return run()
    finally:
        signal.signal(signal.SIGINT, _leave)  # while Python ends


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: an exception could be caught or printed by whatever is being imported. Nothing is open yet."""
    os.write(2, b"amb: interrupted\n")
    os._exit(INTERRUPTED)
