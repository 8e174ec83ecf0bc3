"""A pool of tasks that computes nothing by itself: tests of what asks for tasks answer them."""

from __future__ import annotations

from collections import deque


class WaitingPool:
    """Holds the tasks in the order of their requests; a subclass answers them in `next_finished`."""

    def __class_getitem__(cls, result):
        return cls

    def __init__(self, scheduler, workers):
        self._waiting = deque()

    def __enter__(self):
        return self

    def __exit__(self, *problem):
        pass

    def submit(self, task, key, folder, priority):
        self._waiting.append((key, task))

    def cancel(self, key):
        self._waiting = deque(entry for entry in self._waiting if entry[0] != key)
