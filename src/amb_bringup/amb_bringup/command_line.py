"""Entry point of `amb`. The module imports no command: Ctrl-C is handled before that slow import."""

from __future__ import annotations

import signal

from amb_bringup.startup import ending_signals, leave


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    signal.signal(signal.SIGINT, leave)
    from amb_bringup.cli import main as run

    try:
        return run()
    finally:
        for number in ending_signals():
            signal.signal(number, leave)  # while Python ends
