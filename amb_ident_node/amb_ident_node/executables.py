"""Entry points of the executables. The module imports no node: Ctrl-C is handled before that slow import."""

from __future__ import annotations

from amb_ros.startup import start


def recorder() -> int:
    """Run the node `recorder` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_ident_node.recorder")


def identifier() -> int:
    """Run the node `identifier` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_ident_node.identifier")


def region_monitor() -> int:
    """Run the node `region_monitor` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_ident_node.region_monitor")
