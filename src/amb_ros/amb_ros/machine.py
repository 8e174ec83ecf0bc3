"""Topic `machine` for the nodes that take axes and sample rate from it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.node import Node

from amb_core.ground.errors import MachineError, one_line
from amb_core.loop.machine import Machine as MachineDescription
from amb_core.recording.messages.machine import machine_from_message
from amb_msgs.msg import Machine
from amb_ros import topics
from amb_ros.alarms import RecentProblem
from amb_ros.qos import LATCHED
from amb_ros.subscriptions import create_subscription


class MachineInput:
    """The machine as the plant's side publishes it.

    Parameters
    ----------
    node : Node
        The node that listens.
    on_machine : callable, optional
        Called with every machine that is accepted.

    Attributes
    ----------
    machine : Machine or None
        The last one accepted; None before the first.
    """

    def __init__(self, node: Node, on_machine: Callable[[MachineDescription], None] | None = None) -> None:
        self.machine: MachineDescription | None = None
        self._node = node
        self._on_machine = on_machine
        self._known = threading.Event()
        self._subscription = create_subscription(node, Machine, topics.MACHINE, self._on_message, LATCHED)
        self._waiting = f"waiting for the machine on {self._subscription.topic_name}"
        self._refused = RecentProblem()

    @property
    def problem(self) -> str:
        """Why there is no machine yet, or that one was refused lately; empty if all is well."""
        return self._refused.text if self.machine is not None else self._waiting

    def wait(self, timeout: float) -> MachineDescription:
        """The machine, after waiting for it; not in the thread that handles the node's messages.

        Raises
        ------
        MachineError
            If none arrives within `timeout` (s).
        """
        if not self._known.wait(timeout) or self.machine is None:
            raise MachineError(
                f"no message within {timeout:g} s on {self._subscription.topic_name} with axes and sample rate; "
                "is the simulator, or the bridge to the rig, running?"
            )
        return self.machine

    def _on_message(self, message: Machine) -> None:
        try:
            machine = machine_from_message(message)
        except MachineError as problem:
            refused = f"the machine on {self._subscription.topic_name} is not accepted: {one_line(problem)}"
            self._waiting = refused
            self._refused.note(refused)
            self._node.get_logger().error(refused, throttle_duration_sec=5.0)
            return
        self.machine = machine
        self._known.set()
        if self._on_machine is not None:
            self._on_machine(machine)
