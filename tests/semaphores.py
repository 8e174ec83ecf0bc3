"""Semaphores of Python's multiprocessing, which are files in shared memory: one that is left stays until a reboot."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import psutil

SEMAPHORE = re.compile(r"/dev/shm/sem\.mp-\S+")


def semaphores_of(processes: Iterable[psutil.Process]) -> set[str]:
    """The files that some processes have open."""
    return {file for process in processes for file in SEMAPHORE.findall(Path(f"/proc/{process.pid}/maps").read_text())}


def left_of(semaphores: Iterable[str]) -> list[str]:
    """Those that are still there."""
    return [file for file in semaphores if Path(file).exists()]
