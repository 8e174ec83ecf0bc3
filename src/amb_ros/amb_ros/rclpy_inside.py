"""What the workbench relies on and rclpy does not promise; all of it is public by name, and only used through here.

- An executor looks up `callback` and `send_response` of a service at every request, so both can be replaced.
- The services of rclpy itself have such a `callback`, too, which can be called.
- The descriptors of a node's parameters are its own, not copies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rclpy.node import Node

SEEN_WITH = "7.1.6"
"""Version of rclpy with which the graph tests passed, all of which need this."""


def replace_handling(
    service: Any, callback: Callable[..., Any], send: Callable[[Any, Any], None] | None = None
) -> None:
    """Let a service call another callback, and optionally another function that is to send what that returns."""
    service.callback = callback
    if send is not None:
        service.send_response = send


def call(service: Any, request: Any, response: Any) -> Any:
    """Call the callback of a service, such as one of rclpy itself, without a request from outside."""
    return service.callback(request, response)


def set_read_only(node: Node, name: str, read_only: bool) -> None:
    """Set whether the parameter of a node can be set."""
    node.describe_parameter(name).read_only = read_only


@contextmanager
def writable(node: Node, names: Iterable[str]) -> Iterator[None]:
    """Let a node set its own read-only parameters, for which rclpy has no way."""
    locked = [item for item in node.describe_parameters(list(names)) if item.read_only]
    for item in locked:
        item.read_only = False
    try:
        yield
    finally:
        for item in locked:
            item.read_only = True
