"""Real-time scheduling of the thread that runs a loop: priority, processors, memory that stays in RAM.

Each is an option, since few machines allow them without a change of their settings; see `enter_real_time`.
"""

from __future__ import annotations

import ctypes
import os
import re
import resource
from pathlib import Path

from pydantic import model_validator

from amb_core.ground.parameters import Parameters, choice, quantity, switch

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_CAP_IPC_LOCK = 14  # bit in the effective capabilities of a process
_REMEDY = (
    "to allow it: lines '@realtime - rtprio 99' and '@realtime - memlock unlimited' in /etc/security/limits.conf, your "
    "user in the group realtime, and a new login; in a container: --cap-add SYS_NICE --ulimit rtprio=99 "
    "--ulimit memlock=-1"
)


class RealTimeParameters(Parameters):
    """How the operating system runs the thread of a loop. They apply from the start of the node."""

    priority: int = quantity(0, "-", "real-time priority (SCHED_FIFO) of the thread of the loop; 0 for none", 0, 99)
    lock_memory: bool = switch(False, "keep all memory of the process in RAM (mlockall)")
    processors: str = choice("", "processors on which the thread of the loop runs, such as `3` or `2-3,5`; empty: any")

    @model_validator(mode="after")
    def _processors_are_numbers(self) -> RealTimeParameters:
        processors_of(self.processors)
        return self


def processors_of(text: str) -> set[int]:
    """Numbers of processors in a text such as `2-3,5`.

    Raises
    ------
    ValueError
        If it is none.
    """
    numbers: set[int] = set()
    for part in filter(None, text.replace(" ", "").split(",")):
        if not re.fullmatch(r"\d{1,4}(-\d{1,4})?", part):
            raise ValueError(f"processors = {text!r} is not allowed; allowed: numbers such as '2-3,5'")
        first, _, last = part.partition("-")
        numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


def enter_real_time(parameters: RealTimeParameters) -> str:
    """Schedule the calling thread as asked for; what is not possible is left out.

    Parameters
    ----------
    parameters : RealTimeParameters
        What is asked for. Locked memory is that of the whole process, the rest concerns the calling thread. Threads
        that it makes later run on the same processors, with ordinary priority.

    Returns
    -------
    str
        One line with what was not possible and how to allow it; empty if all was.
    """
    problems = []
    if parameters.processors:
        try:
            os.sched_setaffinity(0, processors_of(parameters.processors))
        except OSError:
            there = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            problems.append(f"real_time.processors = {parameters.processors}: not available; allowed here: {there}")
    denied = []
    if parameters.lock_memory and not _memory_locked():
        denied.append("real_time.lock_memory = true")
    if parameters.priority:
        try:
            policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK  # not for threads that are made later
            os.sched_setscheduler(0, policy, os.sched_param(parameters.priority))
        except OSError:
            denied.append(f"real_time.priority = {parameters.priority}")
    if denied:
        problems.append(f"{' and '.join(denied)}: not permitted on this machine; {_REMEDY}")
    return "; ".join(problems)


def leave_real_time() -> None:
    """Give the calling thread the ordinary priority again."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _memory_locked() -> bool:
    """Whether all memory is locked. Below a finite limit later allocations would fail, so nothing is locked then."""
    limited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] != resource.RLIM_INFINITY
    if limited and not _has_capability(_CAP_IPC_LOCK):
        return False
    return ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0


def _has_capability(number: int) -> bool:
    status = Path("/proc/self/status").read_text()
    effective = re.search(r"^CapEff:\s*([0-9a-f]+)$", status, re.MULTILINE)
    return effective is not None and bool(int(effective[1], 16) >> number & 1)
