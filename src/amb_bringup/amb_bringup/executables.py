"""Where the executables of the package start: it imports no node, so that Ctrl-C is handled before that is done."""

from __future__ import annotations

from amb_ros.startup import start


def composed_loop() -> int:
    """Run the two nodes of the composed loop until SIGINT or SIGTERM."""
    return start("amb_bringup.composed_loop")
