"""Entry points of the executables. The module imports no node: Ctrl-C is handled before that slow import."""

from __future__ import annotations

from amb_ros.startup import start


def pd_controller() -> int:
    """Run the node `pd_controller` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_controller_node.pd_controller")


def state_space_controller() -> int:
    """Run the node `state_space_controller` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_controller_node.state_space_controller")


def excitation_generator() -> int:
    """Run the node `excitation_generator` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_controller_node.excitation_generator")
