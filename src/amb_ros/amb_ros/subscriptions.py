"""Subscriptions that get the history of a topic, and also receive from publishers without history.

A subscription that requests history (transient local) does not match a publisher without history, such as those that
most users write. Here a second subscription without history is opened once such a publisher appears.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from copy import copy
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription


def create_subscription(
    node: Node,
    message_type: Any,
    topic: str,
    callback: Callable[..., None],
    qos: QoSProfile,
    *,
    raw: bool = False,
    with_source_time: bool = False,
) -> Subscription:
    """Subscribe to a topic whose publishers should keep history but need not.

    Messages published while the second subscription is being opened are lost, as with any publisher without history
    that does not wait for its listeners.

    Parameters
    ----------
    node, message_type, topic, raw
        As for `Node.create_subscription`.
    callback : callable
        Called once with every message, and with the time at which it was published if `with_source_time` (ns since
        the epoch by the clock of the publisher; 0 if the middleware does not give it).
    qos : QoSProfile
        Must be transient local.
    with_source_time : bool, optional
        Whether the callback takes the time of publication.

    Returns
    -------
    Subscription
        That for publishers with history; the other one, if any, lives as long as the node.
    """
    if qos.durability != DurabilityPolicy.TRANSIENT_LOCAL:
        raise ValueError(f"topic {topic}: a subscription with durability {qos.durability.name} hears every publisher")
    once = _Once(callback, with_source_time, 2 * qos.depth + 100)

    def open_second(_event: Any) -> None:
        if once.twofold:
            return
        once.twofold = True
        volatile = copy(qos)
        volatile.durability = DurabilityPolicy.VOLATILE
        # Reports a publisher that does not match this one either.
        node.create_subscription(message_type, topic, once, volatile, raw=raw)

    events = SubscriptionEventCallbacks(incompatible_qos=open_second)
    return node.create_subscription(message_type, topic, once, qos, raw=raw, event_callbacks=events)


def create_display_subscription(
    node: Node, message_type: Any, topic: str, callback: Callable[[Any, int], None], depth: int
) -> Subscription:
    """Subscribe to a stream for a display: without history, and without repetition of what gets lost.

    The publisher neither waits for such a listener nor answers it, so that a slow display cannot slow the loop down.

    Parameters
    ----------
    node, message_type, topic
        As for `Node.create_subscription`.
    callback : callable
        Called with every message and the time at which it was published, as in `create_subscription`.
    depth : int
        Messages that wait at most.
    """
    qos = QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )
    return node.create_subscription(message_type, topic, _Once(callback, with_source_time=True, remembered=0), qos)


class _Once:
    """A callback for two subscriptions to one topic that passes each message on once."""

    # So that rclpy passes the message's info too, see `__call__`.
    __signature__ = inspect.Signature(
        [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
    )

    def __init__(self, callback: Callable[..., None], with_source_time: bool, remembered: int) -> None:
        self.twofold = False
        self._callback = callback
        self._with_source_time = with_source_time
        self._remembered = remembered
        self._seen: dict[tuple[int, int], None] = {}  # in order of arrival

    def __call__(self, *received: Any) -> None:
        # EventsExecutor of rclpy 7.1 passes one tuple of message and info, other executors pass the two.
        message, info = received[0] if len(received) == 1 else received
        if self.twofold and self._is_known(info["source_timestamp"], info["publication_sequence_number"]):
            return
        if self._with_source_time:
            self._callback(message, info["source_timestamp"])
        else:
            self._callback(message)

    def _is_known(self, *origin: Any) -> bool:
        """Whether the other subscription has delivered the message: its publisher's time (ns) and number are known."""
        if origin in self._seen:
            del self._seen[origin]
            return True
        self._seen[origin] = None
        if len(self._seen) > self._remembered:
            del self._seen[next(iter(self._seen))]
        return False
