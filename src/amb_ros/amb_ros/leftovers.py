"""Messages that have arrived but were not announced, taken all the same.

EventsExecutor takes as many messages as the middleware announces. Should the middleware announce fewer than it has, for
example where some were sent again, the last ones would stay with it until others follow.
"""

from __future__ import annotations

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

PERIOD = 0.5  # s
MOST = 1000  # messages a subscription and look, so that a stream does not keep the node


def watch_for_leftovers(node: Node) -> None:
    """Let a node look twice a second for messages that nobody announced to it."""
    node.create_timer(PERIOD, lambda: take_leftovers(node), clock=Clock(clock_type=ClockType.STEADY_TIME))


def take_leftovers(node: Node) -> None:
    """Hand on what waits in the subscriptions of a node; in the thread that spins it."""
    for subscription in list(node.subscriptions):
        with subscription.handle:
            for _ in range(MOST):
                if not node.context.ok() or not _take(subscription):
                    break


def _take(subscription: Subscription) -> bool:
    taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    if taken is None:
        return False
    # As EventsExecutor does: the message, or one tuple of message and info.
    message_only = subscription._callback_type is subscription.CallbackType.MessageOnly
    subscription.callback(taken[0] if message_only else taken)
    return True
