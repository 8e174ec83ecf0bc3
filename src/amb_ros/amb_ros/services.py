"""Services that always answer: an error becomes `success=false`, and long work does not block the node's topics."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, cast

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.service import Service

from amb_core.errors import AmbError, one_line

Callback = Callable[[Any, Any], Any]


def create_service(
    node: Node, service_type: Any, name: str, callback: Callback, worker: Executor | None = None
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

    Returns
    -------
    Service
    """

    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except AmbError as problem:
            response.message = one_line(problem)
        except Exception as problem:  # in every case the caller gets an answer and the node keeps running
            node.get_logger().error(traceback.format_exc())
            response.message = f"internal error in {node.get_fully_qualified_name()}: {problem!r}; see its log"
        response.success = False
        return response

    if worker is None:
        return node.create_service(service_type, name, answer)

    # EventsExecutor of Jazzy neither runs coroutines as service callbacks nor has a second thread. So the callback only
    # passes the request on, and the executor's `send_response` leaves the sending to the worker.
    def hand_over(request: Any, response: Any) -> Any:
        return request, response

    service: Any = node.create_service(service_type, name, hand_over)
    send = service.send_response

    def work(call: tuple[Any, Any], header: Any) -> None:
        response = answer(*call)
        with contextlib.suppress(InvalidHandle):  # the node was shut down meanwhile
            if node.context.ok():
                send(response, header)

    service.send_response = lambda call, header: worker.submit(work, call, header)
    return cast(Service, service)
