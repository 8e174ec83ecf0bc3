"""What arrives while an end point begins to be listened at: an answer, a request, a latched message, an event."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from amb_ros.qos import LATCHED
from tests.delayed_listener import delayed_listener
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from tests.graph.conftest import Graph

DELAY = 0.05  # s: much longer than an answer takes
TIMES = 20  # about half of what arrives then would stay unnoticed

BEGINNING = f"""
from std_msgs.msg import Empty
from std_srvs.srv import Trigger
from amb_bringup.client.connection import GraphConnection
from amb_ros.qos import LATCHED
from amb_ros.subscriptions import create_subscription
connection = GraphConnection("", {0.5 * TIMEOUT}, None, ())
node, wait = connection.node, connection.wait_until
wait(lambda: node.count_publishers("/latched") > 0)
for number in range({TIMES}):
"""
ASKING = """
    client = node.create_client(Trigger, "/asked")
    wait(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    wait(answer.done, complaint=f"answer {number} stayed unnoticed")
    node.destroy_client(client)
"""
SUBSCRIBING = """
    received = []
    subscription = node.create_subscription(Empty, "/latched", received.append, LATCHED)
    wait(lambda: received, complaint=f"message {number} stayed unnoticed")
    node.destroy_subscription(subscription)
"""
OFFERING = """
    asked = []
    node.create_service(Trigger, f"/offered_{number}", lambda request, answer: asked.append(request) or answer)
    wait(lambda: asked, complaint=f"request {number} stayed unnoticed")
"""
HEARING = """
    received = []
    create_subscription(node, Empty, f"/stream_{number}", received.append, LATCHED)
    wait(lambda: received, complaint=f"the publisher without history {number} stayed unnoticed")
"""


def ask_in_turn(graph: Graph) -> None:
    """Ask each service of the other process once, as soon as it is there."""
    for number in range(TIMES):
        graph.call(Trigger, f"/offered_{number}")


def publish_in_turn(graph: Graph) -> None:
    """Publish without history on each topic of the other process, which listens for messages before events."""
    subscribed: list[str] = []
    publishers: list[Publisher] = []

    def publish() -> None:
        while subscribed:
            publishers.append(graph.node.create_publisher(Empty, subscribed.pop(), 1))
        for publisher in publishers:
            publisher.publish(Empty())

    # What it publishes begins the next turn, so that each publisher appears so much later than the subscription.
    graph.node.create_timer(3.0 * DELAY, publish)
    for number in range(TIMES):
        topic = f"/stream_{number}"
        graph.wait_until(lambda topic=topic: graph.node.count_subscribers(topic) > 0, topic)
        subscribed.append(topic)


@pytest.mark.parametrize(
    ("program", "other_side"),
    [(ASKING, None), (SUBSCRIBING, None), (OFFERING, ask_in_turn), (HEARING, publish_in_turn)],
    ids=["an answer", "a latched message", "a request", "an event"],
)
def test_what_arrives_while_the_middleware_begins_to_listen_is_noticed(
    graph: Graph, tmp_path: Path, program: str, other_side: Callable[[Graph], None] | None
) -> None:
    graph.environment |= delayed_listener(tmp_path, DELAY)
    graph.node.create_service(Trigger, "/asked", lambda _, answer: answer)
    graph.node.create_publisher(Empty, "/latched", QoSProfile(depth=1, durability=LATCHED.durability)).publish(Empty())
    process = graph.start_command([sys.executable, "-c", BEGINNING + program])
    if other_side is not None:
        other_side(graph)
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 0, process.said
