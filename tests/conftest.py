"""Settings of all tests."""

import signal
from pathlib import Path

import pytest
from hypothesis import settings

# In the background of a shell SIGINT is ignored, and so it would be by the processes that tests start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# A run under nohup ignores SIGHUP, and so would they. A handler that does nothing is not passed on to them.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda _number, _frame: None)

# A run that failed fails again, one that passed passes; on a slow machine too.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

WAITING = ("graph", "fuzz")  # folders of tests that wait for other processes more than they compute


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files of graphs evenly among the others, so that some workers compute while others wait."""
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    place: dict[Path, float] = {}
    for kind in (True, False):
        paths = [path for path in files if (path.parent.name in WAITING) is kind]
        place |= {path: (number + 0.5) / len(paths) for number, path in enumerate(paths)}
    items[:] = [item for path in sorted(files, key=place.__getitem__) for item in files[path]]
