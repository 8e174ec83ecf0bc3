"""Subscriptions that get the history of a topic and hear publishers without history as well, each message once."""

from __future__ import annotations

from copy import copy
from typing import Any

import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message

from amb_msgs.msg import ExcitationStatus
from amb_ros.qos import EVERY_STATE, STREAM
from amb_ros.subscriptions import create_subscription

TOPIC = "/amb/excitation_status"
VOLATILE = copy(EVERY_STATE)
VOLATILE.durability = DurabilityPolicy.VOLATILE


class Heard:
    """A listener, and the ids that it has heard."""

    def __init__(self, graph: Any, raw: bool) -> None:
        self.ids: list[int] = []
        self.graph = graph

        def on_message(message: Any) -> None:
            self.ids.append((deserialize_message(message, ExcitationStatus) if raw else message).id)

        self.subscription = create_subscription(graph.node, ExcitationStatus, TOPIC, on_message, EVERY_STATE, raw=raw)

    def wait_for(self, number: int) -> None:
        self.graph.wait_until(lambda: number in self.ids, f"message {number}")


def publish_once(graph: Any, publisher: Any, number: int) -> None:
    """As `ros2 topic pub --once`: as soon as one subscription matches."""
    graph.wait_until(publisher.get_subscription_count, "a match")
    publisher.publish(ExcitationStatus(id=number))


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("listener_first", [False, True])
def test_a_publisher_without_history_is_heard_once(graph: Any, raw: bool, listener_first: bool) -> None:
    heard = Heard(graph, raw) if listener_first else None
    publisher = graph.add_node("user").create_publisher(ExcitationStatus, TOPIC, VOLATILE)
    heard = heard or Heard(graph, raw)
    for number in (1, 2):
        publish_once(graph, publisher, number)
        heard.wait_for(number)
    assert heard.ids == [1, 2]


@pytest.mark.parametrize("raw", [False, True])
def test_publishers_with_and_without_history_are_each_heard_once(graph: Any, raw: bool) -> None:
    with_history = graph.add_node("node").create_publisher(ExcitationStatus, TOPIC, EVERY_STATE)
    for number in (1, 2):
        with_history.publish(ExcitationStatus(id=number))
    heard = Heard(graph, raw)
    heard.wait_for(2)
    assert heard.ids == [1, 2]  # the history
    without = graph.add_node("user").create_publisher(ExcitationStatus, TOPIC, VOLATILE)
    publish_once(graph, without, 3)
    heard.wait_for(3)
    graph.wait_until(lambda: with_history.get_subscription_count() == 2, "both subscriptions")
    for number in range(4, 24):
        (with_history, without)[number % 2].publish(ExcitationStatus(id=number))
    heard.wait_for(23)
    heard.wait_for(22)
    with_history.publish(ExcitationStatus(id=24))  # after whatever came twice before it
    without.publish(ExcitationStatus(id=25))
    heard.wait_for(24)
    heard.wait_for(25)
    assert sorted(heard.ids) == list(range(1, 26))


def test_the_time_of_publication_is_handed_on(graph: Any) -> None:
    publisher = graph.add_node("node").create_publisher(ExcitationStatus, TOPIC, EVERY_STATE)
    before = graph.node.get_clock().now().nanoseconds
    publisher.publish(ExcitationStatus(id=1))
    after = graph.node.get_clock().now().nanoseconds
    times: list[int] = []
    create_subscription(
        graph.node, ExcitationStatus, TOPIC, lambda _, time: times.append(time), EVERY_STATE, with_source_time=True
    )
    graph.wait_until(lambda: times, "the message")
    assert before <= times[0] <= after


def test_a_subscription_without_history_needs_no_second_one(graph: Any) -> None:
    with pytest.raises(ValueError, match="topic /amb/telemetry: a subscription with durability VOLATILE hears every"):
        create_subscription(graph.node, ExcitationStatus, "/amb/telemetry", print, STREAM)
