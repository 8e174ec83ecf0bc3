"""Corrects a fault of Fast DDS that lets a process hang while it leaves the graph.

`DomainParticipantImpl::set_listener`, called while a participant is destroyed, waits until a running discovery callback
has ended. Its time limit is the largest time of the steady clock. A Fast DDS that is built for an old C library, as the
wheels of ROS 2 are, has no `pthread_cond_clockwait` and converts that limit to the system clock, where it overflows.
`pthread_cond_timedwait` answers a negative time with EINVAL and keeps the mutex, for which the callback waits: the
destructor repeats the call for ever, with the GIL held. It occurs when the nodes of a graph end together, since each
node then hears of the ends of the others.

Here the call is directed to a function that takes an overflowed time for what it means, no limit. Only that call of a
loaded library with the fault is changed, in the memory of this process; see `overflowed_wait.c`.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import mmap
import os
import subprocess
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

from amb_core.ground.files.cache_folder import cache_folder

SOURCE = Path(__file__).with_suffix(".c")
_CORRECTING = threading.Lock()  # two threads may join a graph at the same time, each with a context of its own
LIBRARIES = ("libfastrtps.so", "libfastdds.so")  # names of Fast DDS until version 2, since version 3


def correct() -> None:
    """Correct the middleware of this process if it has the fault; call it before the process joins a graph.

    A correction that is not possible, as without gcc, is a warning: the process works, and may hang when it ends.
    """
    with _CORRECTING:
        _correct_once()


@functools.cache
def _correct_once() -> None:
    get_rmw_implementation_identifier()  # loads the middleware
    for path, address in _loaded_libraries():
        if has_fault(path):
            try:
                correct_at(address)
            except (OSError, RuntimeError, subprocess.SubprocessError) as problem:
                reason = getattr(problem, "stderr", None) or problem
                text = f"{path} has a fault that can hang this process when it ends; it was not corrected: {reason}"
                warnings.warn(text, stacklevel=3)


def correct_at(address: int) -> None:
    """Correct the library that is loaded at an address.

    Raises
    ------
    OSError, RuntimeError, subprocess.SubprocessError
        If the correction cannot be built, or nothing was found to correct.
    """
    count = ctypes.CDLL(str(build())).amb_correct_waits
    count.argtypes = (ctypes.c_size_t,)
    if not count(address):
        raise RuntimeError("the call was not found in the memory of this process")


def _loaded_libraries() -> Iterator[tuple[Path, int]]:
    """Files of Fast DDS in this process, with the addresses of their beginnings."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        span, _, offset, _, _, *rest = line.split(maxsplit=5)
        path = Path(*rest)
        if path.name.startswith(LIBRARIES) and int(offset, 16) == 0:
            yield path, int(span.partition("-")[0], 16)


def has_fault(library: Path) -> bool:
    """Whether a library converts time limits of the steady clock, as it calls only the older of the two functions."""
    with library.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(b"\0pthread_cond_timedwait\0") >= 0 > content.find(b"\0pthread_cond_clockwait\0")


def build() -> Path:
    """The library with the corrected call, built now if there is none of this source in the user's cache."""
    source = SOURCE.read_bytes()
    cache = cache_folder()
    library = cache / f"overflowed_wait-{hashlib.sha256(source).hexdigest()[:16]}.so"
    if not library.exists():
        cache.mkdir(parents=True, exist_ok=True)
        made = library.with_suffix(f".{os.getpid()}")
        command = ["gcc", "-O2", "-Wall", "-shared", "-fPIC", "-o", str(made), str(SOURCE)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        made.replace(library)  # two processes may build it at the same time
    return library
