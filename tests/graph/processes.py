"""Processes under test: what they wrote, where they hang if they do not end, and what they leave in shared memory."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SHARED_MEMORY = Path("/dev/shm")
SEGMENT = re.compile(r"/dev/shm/(fastrtps_[0-9a-f]{16})\b")
DUMP_TIME = 10.0  # s; longest wait for the stacks of a process


class NodeProcess(subprocess.Popen[str]):
    """A process whose errors go to a file: a pipe that nobody reads would stop it when it is full.

    Parameters
    ----------
    command : sequence of str
        What to run.
    errors : Path
        The file.
    **options
        Go to Popen.
    """

    def __init__(self, command: Sequence[str], errors: Path, **options: Any) -> None:
        self._errors = errors
        self.segments: set[str] = set()
        with errors.open("w") as file:
            super().__init__(command, stderr=file, text=True, **options)

    @property
    def said(self) -> str:
        """What the process wrote to stderr so far."""
        return self._errors.read_text(errors="replace")

    def communicate(self, input: str | None = None, timeout: float | None = None) -> tuple[Any, Any]:
        """As that of Popen, with the errors from the file."""
        output, _ = super().communicate(input, timeout)
        return output, self.said

    def open_segments(self) -> set[str]:
        """Names of the segments in shared memory that the process has open, by which others reach its nodes."""
        with contextlib.suppress(OSError):
            return set(SEGMENT.findall(Path(f"/proc/{self.pid}/maps").read_text()))
        return set()

    def send_signal(self, sig: int) -> None:
        """As that of Popen; keeps in mind what SIGKILL gives the process no time to remove."""
        if sig == signal.SIGKILL:
            self.segments |= self.open_segments()
        super().send_signal(sig)

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


def remove_shared_memory(processes: Sequence[NodeProcess]) -> None:
    """Remove the segments of Fast DDS that killed processes of a graph have left; call it when all have ended.

    A segment has a random name, and was seen in the killed process itself. Ports are left alone: they have numbers,
    which the next participant on this machine takes, and Fast DDS itself finds out that their owner is dead.
    """
    for process in processes:
        for name in process.segments:
            for path in (SHARED_MEMORY / name, SHARED_MEMORY / f"{name}_el"):
                path.unlink(missing_ok=True)
