"""Requests to services, polled for their answer. Requests that may be repeated are sent again until the answer."""

from __future__ import annotations

import math
import time
from typing import Any

from rclpy.client import Client
from rclpy.task import Future

POLL_PERIOD = 0.005  # s; `Client.wait_for_service` checks only four times a second
QUICKLY = 0.5  # s until a request is sent again: answers of other users' nodes may get lost, see `middleware`
COMPUTED = 10.0  # s, where a node computes its answer, which it does once for every time that the request is sent


class PendingRequest:
    """A request that is sent as soon as its service is available.

    Parameters
    ----------
    client : Client
        Client of the service.
    request : request of the service
        The request.
    repeat_after : float
        Time without an answer after which it is sent again, because it is idempotent (s); twice as long every time.
    """

    def __init__(self, client: Client, request: Any, repeat_after: float = math.inf) -> None:
        self._client = client
        self._request = request
        self._period = repeat_after
        self._next = -math.inf
        self._futures: list[Future] = []

    def answer(self) -> Any:
        """The response, None as long as there is none; sends the request when it is due."""
        for future in self._futures:
            if future.done():
                return future.result()
        now = time.monotonic()
        if now >= self._next and self._client.service_is_ready():
            self._futures.append(self._client.call_async(self._request))
            self._next = now + self._period
            self._period *= 2.0
        return None

    def forget(self) -> None:
        """Stop waiting for the answer."""
        for future in self._futures:
            self._client.remove_pending_request(future)


def ask(client: Client, request: Any, timeout: float) -> Any:
    """Call a service from another thread than the one that spins its node; None if no answer arrives in time (s).

    The request may be sent more than once.
    """
    deadline = time.monotonic() + timeout
    pending = PendingRequest(client, request, QUICKLY)
    try:
        while (answer := pending.answer()) is None and time.monotonic() < deadline:
            time.sleep(POLL_PERIOD)
    finally:
        pending.forget()
    return answer
