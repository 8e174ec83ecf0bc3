"""Entry point of `amb`. The module imports no command: Ctrl-C is handled before that slow import."""

from __future__ import annotations

import contextlib
import gc
import io
import signal
import sys

from amb_bringup.startup import leave
from amb_ros.interruptions import ending_signals

AT_EXIT = 30.0  # s, in which Python ends; a machine with thirty busy programs needs a few


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    signal.signal(signal.SIGINT, leave)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without a sign shows another, and the command goes on
    from amb_bringup.cli import main as run

    code: str | int | None = 1  # also of an exception
    try:
        code = run()
        return code
    except SystemExit as end:
        code = end.code
        raise
    finally:
        for number in ending_signals():
            signal.signal(number, leave)  # while Python ends
        gc.freeze()  # otherwise Python looks at every object again while it ends, for half a second
        if leaving := sys.modules.get("amb_ros.leaving"):  # otherwise the command was in no graph
            with contextlib.suppress(OSError):  # Python reports it when it ends
                sys.stdout.flush()
            leaving.end_within(AT_EXIT, code if isinstance(code, int) else int(code is not None))
