"""Services that always answer: an error becomes `success=false`, and long work does not block the node's topics."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from amb_core.ground.errors import AmbError, bounded, one_line
from amb_core.ground.plain_text import plain_text
from amb_ros.deferred_answers import Arrival, answer_by


def create_service(
    node: Node,
    service_type: Any,
    name: str,
    callback: Callable[..., Any],
    worker: Executor | None = None,
    on_arrival: Arrival = lambda _request: (),
) -> Service:
    """Offer a service whose response has the fields `success` and `message`.

    Parameters
    ----------
    node : Node
        The node.
    service_type, name, callback
        As for `Node.create_service`. What the callback raises is answered with `success=false`: the text of an
        `AmbError` as one line, anything else as an internal error, with its traceback in the log.
    worker : concurrent.futures.Executor, optional
        Runs the callback, which may then block: on work, or on futures and conditions that the node's own callbacks
        complete. The answer goes out when the callback returns. Without a worker the callback runs in the executor.
    on_arrival : callable, optional
        Called in the executor with a request that arrives, which may be long before the worker is free. What it returns
        are further arguments of the callback.

    Returns
    -------
    Service
    """

    def answer(request: Any, response: Any, *more: Any) -> Any:
        try:
            return callback(request, response, *more)
        except AmbError as problem:
            response.message = one_line(problem)
        except Exception as problem:  # in every case the caller gets an answer and the node keeps running
            node.get_logger().error(plain_text(traceback.format_exc()))
            response.message = bounded(f"internal error in {node.get_fully_qualified_name()}: {problem!r}; see its log")
        response.success = False
        return response

    service = node.create_service(service_type, name, answer)
    answer_by(node, service, answer, worker, on_arrival)
    return service
