"""Starts the node of an executable; an interruption of its start is silent.

The imports of a node take a second or more. Therefore an executable starts here, through a module that imports little.
The signals that end a node are handled before the node's own module is imported. Later `run_nodes` handles them.
"""

from __future__ import annotations

import importlib
import os
import signal
from types import FrameType

from amb_ros.interruptions import ending_signals


def start(module: str) -> int:
    """Import a module and run its `main`; SIGINT, SIGTERM or SIGHUP meanwhile end the process with exit code 0.

    Parameters
    ----------
    module : str
        Full name of the module of the node.
    """
    for number in ending_signals():
        signal.signal(number, _leave)
    code: int = importlib.import_module(module).main()
    return code


def _leave(_number: int, _frame: FrameType | None) -> None:
    """End at once: an exception could be caught or printed by whatever is being imported. Nothing is open yet."""
    os._exit(0)
