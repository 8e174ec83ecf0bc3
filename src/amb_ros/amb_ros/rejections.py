"""Why an action rejected a goal: a rejection in ROS has no text, so the reason is published on a separate topic.

The topic is latched and belongs to the action: `<action>/rejection`. A digest of its content identifies a goal, since
the server does not know the goal's identifier before it accepts.
"""

from __future__ import annotations

import hashlib
from typing import Any

from diagnostic_msgs.msg import KeyValue
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from amb_ros.qos import EVERY_STATE

KEPT_REASONS = 100  # of goals of any client


class RejectionPublisher:
    """Publishes why the goals of an action are rejected, and logs it."""

    def __init__(self, node: Node, action: str) -> None:
        self._logger = node.get_logger()
        self._action = action
        self._publisher = node.create_publisher(KeyValue, f"{action}/rejection", EVERY_STATE)

    def publish(self, goal: Any, reason: str) -> None:
        """Publish the reason for the rejection of a goal."""
        self._logger.warning(f"goal of {self._action} rejected: {reason}")
        self._publisher.publish(KeyValue(key=goal_digest(goal), value=reason))


class RejectionListener:
    """Collects the reasons why goals of an action were rejected."""

    def __init__(self, node: Node, action: str) -> None:
        self._reasons: dict[str, str] = {}  # by digest, the latest at the end
        node.create_subscription(KeyValue, f"{action}/rejection", self._on_rejection, EVERY_STATE)

    def reason(self, goal: Any) -> str | None:
        """Why this goal, or one with the same content, was last rejected; None if that is not known (yet)."""
        return self._reasons.get(goal_digest(goal))

    def forget(self, goal: Any) -> None:
        """Forget the reason for this goal: it is sent again."""
        self._reasons.pop(goal_digest(goal), None)

    def _on_rejection(self, message: KeyValue) -> None:
        self._reasons.pop(message.key, None)
        self._reasons[message.key] = message.value
        if len(self._reasons) > KEPT_REASONS:
            del self._reasons[next(iter(self._reasons))]


def goal_digest(goal: Any) -> str:
    """SHA-256 of the values of a goal as they arrive.

    Not of its bytes: padding bytes between two fields have arbitrary values.
    """
    arrived = deserialize_message(serialize_message(goal), type(goal))
    return hashlib.sha256(repr(arrived).encode("utf-8", "surrogatepass")).hexdigest()
