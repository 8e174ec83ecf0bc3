"""Leaves nothing of ended processes in shared memory, where Fast DDS keeps segments and ports.

A process that is killed, or that ends while one of its threads still uses a node, leaves half a megabyte for each of
its participants, until the memory is full. A process holds the locks of its segments and ports as long as it lives.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Collection
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
SETTLED = 10.0  # s; younger locks may belong to a process that is about to take them

_LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_el")
_PORT_LOCK = re.compile(r"fastrtps_port\d+_el")
_MAPPED = re.compile(rf"{SHARED_MEMORY}/(fastrtps_\S+)")


def remove_dead_segments() -> None:
    """Remove all segments whose process has ended. Ports stay: Fast DDS itself renews those of dead processes."""
    for lock in SHARED_MEMORY.glob("fastrtps_*_el"):
        if _LOCK.fullmatch(lock.name):
            with contextlib.suppress(OSError):  # locked, of another user, or just removed
                _remove_if_dead(lock)


def owned(process: int) -> list[Path]:
    """The segments and ports that a running process has made."""
    try:
        files = [file.readlink() for file in Path(f"/proc/{process}/fd").iterdir()]
    except OSError:  # it has ended, or is of another user
        return []
    return [
        path.with_name(path.name.removesuffix("_el"))
        for path in files
        if path.parent == SHARED_MEMORY and (_LOCK.fullmatch(path.name) or _PORT_LOCK.fullmatch(path.name))
    ]


def remove(files: Collection[Path]) -> None:
    """Remove segments and ports of processes that have ended, or do so now.

    A port that another process has open stays: that process would send to the removed one for ever.
    """
    ports = {path for path in files if _PORT_LOCK.fullmatch(f"{path.name}_el") and path.exists()}
    for path in set(files) - (open_elsewhere() & ports if ports else set()):
        for file in (path, path.with_name(f"{path.name}_el"), path.with_name(f"sem.{path.name}_mutex")):
            with contextlib.suppress(OSError):
                file.unlink(missing_ok=True)


def open_elsewhere() -> set[Path]:
    """Files of Fast DDS that other processes have in their memory."""
    files = set()
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) != os.getpid():
            with contextlib.suppress(OSError):
                maps = process.joinpath("maps").read_text()
                files |= {SHARED_MEMORY / name for name in _MAPPED.findall(maps)}
    return files


def _remove_if_dead(lock: Path) -> None:
    with lock.open("rb") as file:
        if time.time() - os.fstat(file.fileno()).st_mtime < SETTLED:
            return
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        remove([SHARED_MEMORY / lock.name.removesuffix("_el")])
