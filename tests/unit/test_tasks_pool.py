"""Tasks on a cluster that is not ours: what is told when it cannot take up the work."""

from __future__ import annotations

import contextlib
import logging

import pytest

from amb_core.ground.errors import TaskError
from amb_core.ground.tasks import pool

ADDRESS = "tcp://10.0.0.1:8786"


class Future:
    """A task that ended with an error."""

    def __init__(self, key, problem):
        self.key = key
        self._problem = problem

    def add_done_callback(self, callback):
        if self._problem is not None:
            callback(self)

    def result(self):
        raise self._problem


class Client:
    """A cluster on which all tasks end with the same error, or none ends."""

    def __init__(self, problem, workers):
        self._problem, self.workers = problem, workers

    def submit(self, function, *arguments, key, priority):
        return Future(key, self._problem)

    def scheduler_info(self):
        return {"workers": self.workers}

    def cancel(self, futures):
        pass


@pytest.fixture
def tasks(monkeypatch, tmp_path):
    """A pool with a task under way on a given client."""

    @contextlib.contextmanager
    def on(client, scheduler=ADDRESS):
        monkeypatch.setattr(pool, "open_cluster", lambda *options: contextlib.nullcontext(client))
        with pool.TaskPool(scheduler) as tasks_of:
            tasks_of.submit(object(), "k", tmp_path)
            yield tasks_of

    return on


@pytest.mark.parametrize(
    "problem",
    [
        ModuleNotFoundError("No module named 'amb_core'"),
        RuntimeError("Error during deserialization\nof the task graph"),
    ],
)
def test_a_cluster_without_the_code_is_told_so(tasks, problem):
    with tasks(Client(problem, {"w": {}})) as running:
        key, told = running.next_finished(0.0)
    assert key == "k"
    assert isinstance(told, TaskError)
    assert ADDRESS in str(told)
    assert str(problem).splitlines()[0] in str(told)


def test_an_error_of_the_code_itself_is_not_put_down_to_our_own_processes(tasks):
    with tasks(Client(RuntimeError("a bug"), {"w": {}}), scheduler=None) as running, pytest.raises(RuntimeError):
        running.next_finished(0.0)


def test_a_scheduler_that_stays_without_workers_is_told_once(tasks, monkeypatch, caplog):
    monkeypatch.setattr(pool, "ABSENCE", 0.0)
    client = Client(None, {})
    with tasks(client) as running, caplog.at_level(logging.WARNING):
        for _ in range(3):
            assert running.next_finished(0.0) is None
        assert caplog.text.count("has had no workers") == 1
        client.workers = {"w": {}}
        running.next_finished(0.0)
        client.workers = {}
        running.next_finished(0.0)
        assert caplog.text.count("has had no workers") == 2, "told again after there was one"
