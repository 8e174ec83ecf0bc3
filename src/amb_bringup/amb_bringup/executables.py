"""Entry points of the executables. The module imports no node: Ctrl-C is handled before that slow import."""

from __future__ import annotations

from amb_ros.startup import start


def composed_loop() -> int:
    """Run the two nodes of the composed loop until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_bringup.graph.composed_loop")
