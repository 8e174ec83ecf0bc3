"""Entry points of the executables. The module imports no node: Ctrl-C is handled before that slow import."""

from __future__ import annotations

from amb_ros.startup import start


def simulator() -> int:
    """Run the node `simulator` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_sim_node.simulator")


def hardware_bridge() -> int:
    """Run the node `hardware_bridge` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_sim_node.hardware_bridge")


def target_emulator() -> int:
    """Run the node `target_emulator` until SIGINT, SIGTERM or SIGHUP."""
    return start("amb_sim_node.target_emulator")
