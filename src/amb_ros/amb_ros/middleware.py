"""What keeps nodes reachable: settings against lost answers of services, and no segments of dead processes.

A request may reach a service before discovery has matched the service with the client's reader for answers.
rmw_fastrtps then waits 100 ms for the match and drops the answer, with only a warning (ros2/rmw_fastrtps, issue 842). A
loaded machine takes longer. A lost announcement is repeated within about 1.5 s, so 3 s allow for two of them. Parameter
services and actions of a node wait equally long, since the middleware does the waiting. Middlewares other than
rmw_fastrtps ignore these settings. `network` says who can reach the nodes, `overflowed_wait` which fault is corrected.

A killed process leaves half a megabyte in shared memory for each of its participants, until that is full.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from pathlib import Path

from amb_ros import network, overflowed_wait

PROFILES = Path(__file__).with_name("fast_dds.xml")
LOCAL_PROFILES = Path(__file__).with_name("fast_dds_local.xml")
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
SHARED_MEMORY = Path("/dev/shm")
SETTLED = 10.0  # s; younger locks may belong to a process that is about to take them

_LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_el")


def configure() -> None:
    """Apply the settings to this process unless the user has set their own; call it before `rclpy.init`.

    Then correct the fault by which a process can hang when it ends.
    """
    os.environ.setdefault(VARIABLE, str(LOCAL_PROFILES if network.is_local() else PROFILES))
    overflowed_wait.correct()


def remove_dead_segments() -> None:
    """Remove the segments of Fast DDS whose process has ended: a living one holds the lock of each of its segments.

    Ports are left alone: others may still have them open, and Fast DDS itself renews those of dead processes.
    """
    for lock in SHARED_MEMORY.glob("fastrtps_*_el"):
        if _LOCK.fullmatch(lock.name):
            with contextlib.suppress(OSError):  # locked, of another user, or just removed
                _remove_if_dead(lock)


def _remove_if_dead(lock: Path) -> None:
    with lock.open("rb") as file:
        if time.time() - os.fstat(file.fileno()).st_mtime < SETTLED:
            return
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        (SHARED_MEMORY / lock.name.removesuffix("_el")).unlink(missing_ok=True)
        lock.unlink()
