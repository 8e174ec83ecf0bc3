"""The far end of the bare ping-pong: answers every position with a current reference of the same step."""

from __future__ import annotations

from rclpy.node import Node

from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros.process import run_node
from amb_ros.qos import STREAM
from amb_ros.sample_messages import pack_current, unpack_position


class Pong(Node):
    """No work but the answer."""

    def __init__(self) -> None:
        super().__init__("pong", namespace="amb")
        self._publisher = self.create_publisher(CurrentReference, "pong", STREAM)
        self.create_subscription(RotorPosition, "ping", self._on_ping, STREAM, raw=True)

    def _on_ping(self, data: bytes) -> None:
        run, step, _, position = unpack_position(data)
        self._publisher.publish(pack_current(run, step, position))


if __name__ == "__main__":
    raise SystemExit(run_node(Pong))
