"""Answers of a controller or bridge to the messages of the topic excitation: one for each, on `excitation_status`.

A bridge reports there, too, that an excitation has ended before its last step.
"""

from __future__ import annotations

from rclpy.node import Node

from amb_msgs.msg import Excitation, ExcitationStatus
from amb_ros import topics
from amb_ros.excitation_messages import STOP, length
from amb_ros.qos import EVERY_STATE

LONGEST_KIND = 50  # characters of it that are repeated in an answer

Identity = tuple[int, int, str, str, int, int, int]


class ExcitationAnswers:
    """Publishes the answers of a node.

    Parameters
    ----------
    node : Node
        The controller or bridge.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(ExcitationStatus, topics.EXCITATION_STATUS, EVERY_STATE)

    def accept(self, status: ExcitationStatus, first_step: int, steps: int) -> None:
        """Answer that an excitation is applied from a step onwards, for a number of steps."""
        status.accepted, status.first_step, status.steps = True, first_step, steps
        self._publish(status)

    def refuse(self, status: ExcitationStatus, reason: str) -> None:
        """Answer that an excitation is not applied, and why."""
        status.accepted, status.message = False, reason
        self._node.get_logger().warning(f"excitation {status.id} refused: {reason}")
        self._publish(status)

    def end(self, run: int, number: int, step: int) -> None:
        """Report that an accepted excitation ends at a step, before its last one."""
        self._publish(ExcitationStatus(run=run, id=number, kind=STOP, accepted=True, first_step=step))

    def _publish(self, status: ExcitationStatus) -> None:
        if self._node.context.ok():
            self._publisher.publish(status)


def answer_to(message: Excitation) -> ExcitationStatus:
    """An answer to a message, not yet decided."""
    return ExcitationStatus(run=message.run, id=message.id, kind=message.kind[:LONGEST_KIND])


def identity_of(message: Excitation, first_step: int) -> Identity:
    """What is equal in two copies of an excitation, with its step as it was resolved.

    More than its number: two generators, or an own node of a user, may choose the same ones.
    """
    return (
        message.run, message.id, message.kind, message.description, message.steps or length(message),
        message.checksum, int(first_step),
    )  # fmt: skip
