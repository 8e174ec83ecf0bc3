"""The publishers of recorded topics: waits until those that exist are connected, and what they offer."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.subscription import Subscription

from amb_ident_node.recorded_topics import RecordedTopic
from amb_ros import topics
from amb_ros.diagnostics import UNKNOWN_NODES
from amb_ros.qos import offered_profile

DISCOVERY_TIMEOUT = 2.0  # s
DISCOVERY_QUIET = 1.0  # s without a new publisher, after which all are assumed to be known
DISCOVERY_END = 10.0  # s after the start of the node, after which all are assumed to be known


class Publishers:
    """Publishers of topics to which a node has subscribed.

    Parameters
    ----------
    node : Node
        The node, which has just started.
    recorded : mapping of str to RecordedTopic
        The topics by full name.
    subscriptions : mapping of str to Subscription
        The subscriptions by full name of the topic.
    """

    def __init__(
        self, node: Node, recorded: Mapping[str, RecordedTopic], subscriptions: Mapping[str, Subscription]
    ) -> None:
        self._node = node
        self._recorded = recorded
        self._by_topic = subscriptions
        self._born = time.monotonic()

    def offered(self, name: str) -> list[dict[str, Any]]:
        """Quality of service that the publishers of a topic offer; the workbench's own if there is none yet."""
        topic = self._recorded[name]
        profiles = [info.qos_profile for info in self._node.get_publishers_info_by_topic(name)]
        offered: list[dict[str, Any]] = []
        for profile in profiles or [topic.offered]:
            words = offered_profile(profile, topic.offered)
            if words not in offered:
                offered.append(words)
        return offered

    def nodes_of(self, names: Iterable[str]) -> dict[str, set[str]]:
        """The nodes that publish some topics, by full name, with the topics of each."""
        nodes: dict[str, set[str]] = {}
        for topic in names:
            for end in self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic)):
                if end.node_name not in UNKNOWN_NODES:
                    nodes.setdefault(f"{end.node_namespace.rstrip('/')}/{end.node_name}", set()).add(topic)
        return nodes

    def wait_for(self) -> None:
        """Wait until controller and simulator publish and the publishers that exist are connected."""
        deadline = time.monotonic() + DISCOVERY_TIMEOUT
        expected = [self._node.resolve_topic_name(name) for name in (topics.TELEMETRY, topics.SIMULATOR_STATE)]
        while not all(map(self._node.count_publishers, expected)) and time.monotonic() < deadline:
            time.sleep(0.01)
        self._wait_for_discovery()
        deadline = time.monotonic() + DISCOVERY_TIMEOUT
        while (waiting := self._unconnected()) and time.monotonic() < deadline:
            time.sleep(0.01)
        for name in waiting:
            self._node.get_logger().warning(
                f"not connected to every publisher of {name}; are their QoS settings compatible?"
            )

    def _wait_for_discovery(self) -> None:
        """Wait, soon after the start of the node, until no new publisher appears: some may not be known yet."""
        known, quiet_since = -1, time.monotonic()
        while (now := time.monotonic()) < min(quiet_since + DISCOVERY_QUIET, self._born + DISCOVERY_END):
            publishers = sum(map(self._node.count_publishers, self._recorded))
            if publishers != known:
                known, quiet_since = publishers, now
            time.sleep(0.01)

    def _unconnected(self) -> list[str]:
        """Topics with publishers that have not been matched with the subscription."""
        waiting = []
        for name, subscription in self._by_topic.items():
            offers = [end.qos_profile.durability for end in self._node.get_publishers_info_by_topic(name)]
            # Publishers without history have a subscription of their own.
            fitting = (
                offers.count(DurabilityPolicy.TRANSIENT_LOCAL) if self._recorded[name].keeps_history else len(offers)
            )
            if subscription.get_publisher_count() < fitting:
                waiting.append(name)
        return waiting
