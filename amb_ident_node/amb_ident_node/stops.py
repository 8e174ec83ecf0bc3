"""Requests to stop that have no answer yet: the newest says up to which step, the most urgent how long."""

from __future__ import annotations

import time
from typing import NamedTuple

from amb_core.ground.errors import BagError
from amb_ident_node.bag_in_progress import BagInProgress
from amb_msgs.srv import StopRecording

DEFAULT_TIMEOUT = 10.0  # s
LONGEST_TIMEOUT = 3600.0  # s


class Stop(NamedTuple):
    """A request to stop, with the recording that was in progress when it arrived."""

    request: StopRecording.Request
    deadline: float  # in the steady clock (s)
    recording: BagInProgress | None


class Stops:
    """The requests, in the order of their arrival. They arrive in one thread and are answered in another."""

    def __init__(self) -> None:
        self._waiting: list[Stop] = []

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def arrive(self, request: StopRecording.Request, recording: BagInProgress | None) -> Stop:
        """A request has arrived; one with a timeout that is not allowed hurries nobody."""
        stop = Stop(request, time.monotonic() + (request.timeout or DEFAULT_TIMEOUT), recording)
        if 0.0 <= request.timeout <= LONGEST_TIMEOUT:
            self._waiting.append(stop)
        return stop

    def require(self, stop: Stop) -> None:
        """Raise BagError if the timeout of a request is not allowed."""
        if not any(waiting is stop for waiting in self._waiting):
            raise BagError(
                f"timeout = {stop.request.timeout} s is not allowed; allowed: 0 (for {DEFAULT_TIMEOUT:g} s) "
                f"to {LONGEST_TIMEOUT:g} s"
            )

    def answered(self, stop: Stop) -> None:
        """A request is being answered, and hurries nobody any more."""
        self._waiting.remove(stop)

    @property
    def newest(self) -> Stop:
        """The one that arrived last."""
        return self._waiting[-1]

    @property
    def time_left(self) -> float:
        """How long all of them may still wait (s)."""
        return min(stop.deadline for stop in tuple(self._waiting)) - time.monotonic()
