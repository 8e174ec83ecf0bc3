"""Requests to services, polled for their answer. Requests that may be repeated are sent again until the answer."""

from __future__ import annotations

import math
import time
from typing import Any

from rclpy.client import Client
from rclpy.task import Future

POLL_PERIOD = 0.005  # s; `Client.wait_for_service` checks only four times a second
REPEAT_PERIOD = 0.5  # s; answers of other users' nodes may get lost, see `middleware`


class PendingRequest:
    """A request that is sent as soon as its service is available.

    Parameters
    ----------
    client : Client
        Client of the service.
    request : request of the service
        The request.
    repeated : bool
        Whether it may be sent again, because it is idempotent.
    """

    def __init__(self, client: Client, request: Any, repeated: bool) -> None:
        self._client = client
        self._request = request
        self._period = REPEAT_PERIOD if repeated else math.inf
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
    pending = PendingRequest(client, request, repeated=True)
    try:
        while (answer := pending.answer()) is None and time.monotonic() < deadline:
            time.sleep(POLL_PERIOD)
    finally:
        pending.forget()
    return answer
