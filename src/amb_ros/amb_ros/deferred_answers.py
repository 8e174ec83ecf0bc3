"""Answers that a worker sends.

EventsExecutor of Jazzy neither runs coroutines as callbacks of services nor has a second thread. So the callback only
hands a request over, and the `send_response` that the executor calls next leaves the work to a worker.
"""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from amb_core.ground.errors import bounded
from amb_core.ground.plain_text import plain_text
from amb_ros.message_texts import with_plain_texts
from amb_ros.rclpy_inside import replace_handling

Work = Callable[..., Any]
Arrival = Callable[[Any], tuple[Any, ...]]


def answer_by(
    node: Node, service: Any, work: Work, worker: Executor | None, on_arrival: Arrival = lambda _request: ()
) -> None:
    """Let a worker answer the requests of a service, or the executor itself if there is none.

    Every request gets an answer: where that of `work` cannot be sent, an empty one with the reason in `message`, if the
    response has such a field. Requests and answers are logged at level debug, with the number that the client has given
    to the request.

    Parameters
    ----------
    node, service
        The node, and a service of it.
    work : callable
        Called with request and response, and with what `on_arrival` returned; returns the response. Must not raise.
    worker : concurrent.futures.Executor or None
        Calls `work`, which may then block.
    on_arrival : callable, optional
        Called in the executor with a request that arrives.
    """
    send = service.send_response

    def hand_over(request: Any, response: Any) -> tuple[Any, ...]:
        return request, response, *on_arrival(request)

    def do(call: tuple[Any, ...], header: Any, number: int) -> None:
        response = work(*call)
        with contextlib.suppress(InvalidHandle):  # the node was shut down meanwhile
            if node.context.ok():
                _send(node, send, response, header)
                node.get_logger().debug(f"{service.srv_name}: answered request {number}")

    def take(call: tuple[Any, ...], header: Any) -> None:
        number = getattr(header, "request_id", header).sequence_number
        node.get_logger().debug(f"{service.srv_name}: received request {number}")
        if worker is None:
            do(call, header, number)
        else:
            worker.submit(do, call, header, number)

    replace_handling(service, hand_over, take)


def _send(node: Node, send: Callable[[Any, Any], None], response: Any, header: Any) -> None:
    """Send a response, or, where that fails, an empty one with the reason."""
    try:
        send(with_plain_texts(response), header)
    except InvalidHandle:
        raise
    except Exception as problem:
        if not node.context.ok():
            raise
        node.get_logger().error(plain_text(traceback.format_exc()))
        apology = type(response)()
        if hasattr(apology, "message"):
            name = node.get_fully_qualified_name()
            apology.message = bounded(f"internal error in {name}: its answer cannot be sent: {problem!r}; see its log")
        send(apology, header)
