"""Entry point of `amb`. The module imports no command: Ctrl-C is handled before that slow import."""

from __future__ import annotations

import signal

from amb_bringup.startup import leave


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    signal.signal(signal.SIGINT, leave)
    from amb_bringup.cli import main as run

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a command may have something to close
    try:
        return run()
    finally:
        signal.signal(signal.SIGINT, leave)  # while Python ends
