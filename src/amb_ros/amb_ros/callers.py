"""Who may have sent a request or a message: rclpy does not show it, but the graph shows who has a client for it."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo


def callers(node: Node, service: str) -> str:
    """Full names of the nodes that can have called a service, as text for a log.

    Parameters
    ----------
    node : Node
        The node that offers it.
    service : str
        Its name, relative to the node, such as `~/reset_faults`.
    """
    topic = f"rq{node.resolve_service_name(service)}Request"  # of rmw_fastrtps and rmw_cyclonedds
    return _named(node.get_publishers_info_by_topic(topic, no_mangle=True))


def publishers(node: Node, topic: str) -> str:
    """Full names of the nodes that publish a topic, as text for a log."""
    return _named(node.get_publishers_info_by_topic(topic))


def _named(endpoints: Iterable[TopicEndpointInfo]) -> str:
    names = sorted({f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints})
    if not names:
        return "a node that has left"
    return names[0] if len(names) == 1 else f"one of {', '.join(names)}"
