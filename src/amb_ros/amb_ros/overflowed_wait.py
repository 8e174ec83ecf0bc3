"""Corrects a fault of Fast DDS that lets a process hang while it leaves the graph.

`DomainParticipantImpl::set_listener`, called while a participant is destroyed, waits until a running discovery callback
has ended. Its time limit is the largest time of the steady clock. A Fast DDS that is built for an old C library, as the
wheels of ROS 2 are, has no `pthread_cond_clockwait` and converts that limit to the system clock, where it overflows.
`pthread_cond_timedwait` answers a negative time with EINVAL and keeps the mutex, for which the callback waits: the
destructor repeats the call for ever, with the GIL held. It occurs when the nodes of a graph end together, since each
node then hears of the ends of the others.

Here the call is directed to a function that takes an overflowed time for what it means, no limit.
"""

from __future__ import annotations

import ctypes
import functools
import mmap
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

from amb_ros.corrected_calls import attempt, functions, loaded_libraries, once, require_found

LIBRARIES = ("libfastrtps.so", "libfastdds.so")  # names of Fast DDS until version 2, since version 3
HARM = "that can hang this process when it ends"


def _correct() -> None:
    get_rmw_implementation_identifier()  # loads the middleware
    for path, address in loaded_libraries(*LIBRARIES):
        if has_fault(path):
            attempt(path, HARM, functools.partial(correct_at, address))


correct = once(_correct)
"""Correct the middleware of this process if it has the fault; call it before the process joins a graph.

Two threads may join a graph at the same time, each with a context of its own. A correction that is not possible is a
warning: the process works, and may hang when it ends.
"""


def correct_at(address: int) -> None:
    """Correct the library that is loaded at an address.

    Raises
    ------
    OSError, RuntimeError, subprocess.SubprocessError
        If the correction cannot be built, or nothing was found to correct.
    """
    count = functions().amb_correct_waits
    count.argtypes = (ctypes.c_size_t,)
    require_found(count(address))


def has_fault(library: Path) -> bool:
    """Whether a library converts time limits of the steady clock, as it calls only the older of the two functions."""
    with library.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(b"\0pthread_cond_timedwait\0") >= 0 > content.find(b"\0pthread_cond_clockwait\0")
