"""Corrects a fault of rmw_fastrtps by which the first answer, request or message of an end point can stay unnoticed.

An executor that works by events asks the middleware to be called when something arrives. rmw_fastrtps counts what has
arrived before, and only then begins to listen (`set_on_new_response_callback` in its `custom_client_info.hpp`, and the
same of services, subscriptions and events). What arrives in between lies there until something else arrives at the same
end point: an answer that never comes, or a latched message that nobody receives. It takes a busy machine, as the time
in between is some microseconds long, unless the process loses its processor there.

Here those calls of rcl are directed to functions that make them twice: the second one counts what the first one missed.
Everything that has arrived is counted once, so that it does nothing else.
"""

from __future__ import annotations

import ctypes
import functools
import os
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

from amb_ros.corrected_calls import attempt, functions, loaded_libraries, once, require_found

CALLER = "librcl.so"
CALLS = (
    "rmw_client_set_on_new_response_callback",
    "rmw_service_set_on_new_request_callback",
    "rmw_subscription_set_on_new_message_callback",
    "rmw_event_set_callback",
)
HARM = "by which an answer or a message can stay unnoticed on a busy machine"


def _correct() -> None:
    if get_rmw_implementation_identifier().startswith("rmw_fastrtps"):  # loads it, too
        for path, address in loaded_libraries(CALLER):
            attempt(path, HARM, functools.partial(correct_at, path, address))


correct = once(_correct)
"""Correct rcl in this process if its middleware has the fault; call it before the process joins a graph.

A correction that is not possible is a warning: the process works, and whoever waits for an answer has to ask again.
"""


def correct_at(library: Path, address: int) -> None:
    """Correct the rcl that is loaded at an address, from this file.

    Raises
    ------
    OSError, RuntimeError, subprocess.SubprocessError
        If the correction cannot be built, or nothing was found to correct.
    """
    rcl = ctypes.CDLL(str(library), mode=os.RTLD_NOLOAD | os.RTLD_LAZY)  # and what it calls
    count = functions().amb_correct_arrivals
    count.argtypes = (ctypes.c_size_t, *(ctypes.c_void_p,) * len(CALLS))
    require_found(count(address, *(ctypes.cast(getattr(rcl, name), ctypes.c_void_p) for name in CALLS)))
