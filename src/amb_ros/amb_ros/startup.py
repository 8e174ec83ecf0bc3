"""Starts the node of an executable such that an interruption of its start is silent.

The imports of a node take a second or more. An executable therefore enters here, through a module that imports nothing
else, and the signals that end a node are handled before its own module is imported. `run_nodes` takes them over.
"""

from __future__ import annotations

import importlib
import os
import signal
from types import FrameType


def start(module: str) -> int:
    """Import a module and run its `main`; SIGINT or SIGTERM meanwhile end the process with exit code 0.

    Parameters
    ----------
    module : str
        Full name of the module of the node.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    code: int = importlib.import_module(module).main()
    return code


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: an exception could be caught or printed by whatever is being imported. Nothing is open yet."""
    os._exit(0)
