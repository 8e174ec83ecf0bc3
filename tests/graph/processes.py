"""Processes under test: what they wrote, where they hang if they do not end, and what they leave in shared memory."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import select
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_ros import shared_memory
from amb_ros.shared_memory import SHARED_MEMORY

if TYPE_CHECKING:
    from tests.graph.zygote import Zygote

SEGMENT = re.compile(r"/dev/shm/(fastrtps_[0-9a-f]{16})\b")
DUMP_TIME = 10.0  # s; longest wait for the stacks of a process


class NodeProcess:
    """A process under test. Its errors go to a file: a pipe that nobody reads would stop it when it is full."""

    args: Any
    pid: int
    returncode: int | None

    def __init__(self, errors: Path) -> None:
        self._errors = errors
        self.segments: set[str] = set()

    @property
    def said(self) -> str:
        """What the process wrote to stderr so far."""
        return self._errors.read_text(errors="replace")

    def open_segments(self) -> set[str]:
        """Names of the segments in shared memory that the process has open, by which others reach its nodes."""
        return segments_of(self.pid)

    def send_signal(self, sig: int) -> None:
        """Send a signal, unless the process has ended; keeps in mind what SIGKILL gives it no time to remove."""
        if sig == signal.SIGKILL:
            self.segments |= self.open_segments()
        if self.poll() is None:
            os.kill(self.pid, sig)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def wait_for_end(self, timeout: float) -> None:
        """Wait for the end.

        Raises
        ------
        AssertionError
            If it does not come; with the stacks of all threads. The process is killed.
        """
        try:
            self.wait(timeout)
        except subprocess.TimeoutExpired:
            problem = f"process {self.pid} did not end within {timeout:g} s: {self.args}"
            stacks = self._stacks()
            self.kill()
            self.wait()
            raise AssertionError(f"{problem}\n{stacks}") from None

    def _stacks(self) -> str:
        """The errors of the process with the stacks of its threads, which it writes on SIGUSR1."""
        before = len(self.said)
        self.send_signal(signal.SIGUSR1)
        deadline = time.monotonic() + DUMP_TIME
        while self.poll() is None and len(self.said) == before and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.2)  # for the rest of the lines
        return self.said


class Program(NodeProcess, subprocess.Popen[str]):
    """A program that is started as users start it.

    Parameters
    ----------
    command : sequence of str
        What to run.
    errors : Path
        The file of its errors.
    **options
        Go to Popen.
    """

    def __init__(self, command: Sequence[str], errors: Path, **options: Any) -> None:
        NodeProcess.__init__(self, errors)
        with errors.open("w") as file:
            subprocess.Popen.__init__(self, command, stderr=file, text=True, **options)

    def communicate(self, input: str | None = None, timeout: float | None = None) -> tuple[Any, Any]:
        """As that of Popen, with the errors from the file."""
        output, _ = super().communicate(input, timeout)
        return output, self.said


class ForkedNode(NodeProcess):
    """A node whose process begins with its module imported, see `tests.graph.zygote`.

    Parameters
    ----------
    zygote : Zygote
        Starts it.
    args : sequence of str
        The module, and its arguments.
    errors : Path
        The file of its errors.
    env : mapping of str to str
        Its environment.
    cwd : Path
        The folder in which it runs.
    """

    def __init__(self, zygote: Zygote, args: Sequence[str], errors: Path, env: Mapping[str, str], cwd: Path) -> None:
        super().__init__(errors)
        self.args, self.returncode = args, None
        with errors.open("w") as file:
            self.pid, self._ended = zygote.fork(args, file.fileno(), env, cwd)

    def poll(self) -> int | None:
        """As that of Popen."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """As that of Popen."""
        if self.returncode is None:
            if not select.select([self._ended], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(list(self.args), timeout or 0.0)
            status = os.read(self._ended, 16)
            os.close(self._ended)
            self.returncode = os.waitstatus_to_exitcode(int(status))
        return self.returncode


def remove_shared_memory(processes: Sequence[NodeProcess]) -> None:
    """Remove the segments of Fast DDS that killed processes of a graph have left; call it when all have ended.

    A segment has a random name, and was seen in the killed process itself, which also has those of its peers open: one
    whose lock is held is of a process that lives. Ports are left alone: they have numbers, which the next participant
    on this machine takes, and Fast DDS itself finds out that their owner is dead.
    """
    for process in processes:
        for name in process.segments:
            with contextlib.suppress(OSError), (SHARED_MEMORY / f"{name}_el").open("rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shared_memory.remove([SHARED_MEMORY / name])


def segments_of(pid: int) -> set[str]:
    """Names of the segments in shared memory that a process has open."""
    with contextlib.suppress(OSError):
        return set(SEGMENT.findall(Path(f"/proc/{pid}/maps").read_text()))
    return set()
