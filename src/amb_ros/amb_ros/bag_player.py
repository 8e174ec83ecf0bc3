"""Plays a bag: publishes the messages of simulator and controller again, at the recorded or another rate."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from amb_core.ground.errors import BagError
from amb_core.recording.bag_reader import BagApart
from amb_core.recording.layout import layout_hash
from amb_core.recording.storage import Definition
from amb_msgs.msg import Excitation, ExcitationStatus, LoopSamples, Machine, PlantState, SimulatorState
from amb_ros.definitions import message_definition
from amb_ros.qos import HISTORY, LATCHED

DISCOVERY_TIMEOUT = 10.0  # s; longest wait for the first listener
SETTLING_TIME = 1.0  # s without a new listener: the subscriptions of one node are not matched all at once
STAYING_TIME = 4.0  # s without a new listener before the player leaves: DDS repeats a lost announcement after 3 s
DELIVERY_TIMEOUT = 10.0  # s
SLOWEST, FASTEST = 1e-3, 1e6


class _Played(NamedTuple):
    type: Any
    qos: QoSProfile


PLAYED = {
    "amb_msgs/msg/Machine": _Played(Machine, LATCHED),
    "amb_msgs/msg/LoopSamples": _Played(LoopSamples, HISTORY),
    "amb_msgs/msg/PlantState": _Played(PlantState, HISTORY),
    "amb_msgs/msg/Excitation": _Played(Excitation, LATCHED),
    "amb_msgs/msg/ExcitationStatus": _Played(ExcitationStatus, LATCHED),
    "amb_msgs/msg/SimulatorState": _Played(SimulatorState, LATCHED),
}
"""Topics that are played. Regions, maps and models are not: the listening nodes compute them again."""


class BagPlayer:
    """A bag ready to be played on the topics on which it was recorded.

    Parameters
    ----------
    node : Node
        Node that publishes; it need not be spun.
    path : str or Path
        The bag.

    Attributes
    ----------
    messages : int
        Number of messages to play.

    Raises
    ------
    BagError
        If there is no bag, nothing to play in it, or a message type had other fields when it was recorded.
    """

    def __init__(self, node: Node, path: str | Path) -> None:
        self._node = node
        self._path = Path(path)
        self._bag = BagApart(self._path)
        counts = self._bag.call("survey", [])["counts"]  # after this pass its definitions are complete
        topics = {(topic, message_type): count for topic, message_type, count in counts if message_type in PLAYED}
        self.messages = sum(topics.values())
        if not self.messages:
            raise BagError(f"bag {path}: nothing to play; played are: {', '.join(PLAYED)}")
        self._listeners = 0
        self._last_new = 0.0  # when their number last changed (s, monotonic)
        self._publishers: dict[str, Publisher] = {}
        for topic, message_type in sorted(topics):
            self._check_layout(message_type)
            played = PLAYED[message_type]
            self._publishers[topic] = node.create_publisher(played.type, topic, played.qos)

    def play(self, rate: float = 1.0, progress: Callable[[int], None] | None = None) -> None:
        """Wait for listeners, publish all messages, and wait until they have arrived.

        Without a listener they are published anyway, with a warning. Listeners that are discovered late receive what
        they missed: the player stays until no new one has appeared for some seconds.

        Parameters
        ----------
        rate : float, optional
            How many times faster than recorded.
        progress : callable, optional
            Called with the number of messages published after each of them.

        Raises
        ------
        BagError
            If the rate is not allowed, or a listener has not received everything.
        """
        if not SLOWEST <= rate <= FASTEST:
            raise BagError(f"rate = {rate:g} is not allowed; allowed: {SLOWEST:g} to {FASTEST:g}")
        self._wait_for_listeners()
        start, first = time.monotonic(), None
        stored = BagApart(self._path).messages(list(self._publishers), stored=True, decoded=False)
        for played, message in enumerate(stored, start=1):
            first = message.log_time if first is None else first
            time.sleep(max(0.0, start + 1e-9 * (message.log_time - first) / rate - time.monotonic()))
            self._publishers[message.topic].publish(message.data)
            if progress is not None:
                progress(played)
        self._wait_for_late_listeners()
        for topic, publisher in self._publishers.items():
            if not publisher.wait_for_all_acked(Duration(seconds=DELIVERY_TIMEOUT)):
                raise BagError(f"bag {self._path}: a listener to {topic} has not received everything; play it slower")

    def _wait_for_listeners(self) -> None:
        """Wait until a node listens and no further listener appears, or until the timeout without any."""
        start = self._last_new = time.monotonic()
        while not self._settled_for(SETTLING_TIME):
            if not self._listeners and time.monotonic() - start >= DISCOVERY_TIMEOUT:
                self._node.get_logger().warning(
                    f"no subscriber to {', '.join(self._publishers)} after {DISCOVERY_TIMEOUT:g} s; "
                    "the bag is played anyway"
                )
                return
            time.sleep(0.01)

    def _wait_for_late_listeners(self) -> None:
        while self._listeners and not self._settled_for(STAYING_TIME):
            time.sleep(0.01)

    def _settled_for(self, duration: float) -> bool:
        """Whether there are listeners, and none has appeared within this time (s)."""
        listeners = sum(publisher.get_subscription_count() for publisher in self._publishers.values())
        if listeners != self._listeners:
            self._listeners, self._last_new = listeners, time.monotonic()
        return listeners > 0 and time.monotonic() - self._last_new >= duration

    def _check_layout(self, message_type: str) -> None:
        """Refuse messages that the listeners would misread because their fields have changed."""
        installed = Definition("ros2msg", message_definition(message_type))
        if self._bag.call("layout", message_type) != layout_hash(message_type, installed):
            raise BagError(f"bag {self._path}: {message_type} had other fields when it was recorded; cannot be played")
