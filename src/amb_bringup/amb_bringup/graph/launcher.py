"""Runs the nodes of a launch file as separate processes: starts, monitors and stops them, and leaves nothing behind.

`ros2 launch` does this where it is installed. This module needs no `launch` packages, and is easy to use from Python:

    with Graph.from_launch_file(launch_file("bearing"), env={"ROS_DOMAIN_ID": "7"}) as graph:
        ...
        graph.check()  # raises as soon as a node has ended
"""

from __future__ import annotations

import functools
import os
import signal
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from amb_bringup.graph.launch_file import NodeProcess, read_launch_file
from amb_bringup.graph.packages import LaunchError, share_folder
from amb_ros import interruptions, shared_memory
from amb_ros.domain import DOMAIN, require_domain

POLL_PERIOD = 0.05  # s
# Signal, patience (s). Not SIGINT: an interpreter that is still starting would write a traceback. On a busy machine a
# bag takes a while to close. With SIGUSR1 a node shows where it hangs.
STOP_STAGES = ((signal.SIGTERM, 20.0), (signal.SIGUSR1, 0.5), (signal.SIGKILL, 5.0))
RESERVING_PORTS = 32768  # plus domain; `domain_coordinator`, by which ROS tests reserve theirs, takes the same
KEPT_LINES = 50  # of each node's output, for error messages

Output = Callable[[str, str], None]


def launch_file(name: str) -> Path:
    """Path of a launch file of this package: `bearing` (separate processes) or `composed`."""
    return share_folder("amb_bringup") / "launch" / f"{name}.launch.yaml"


def own_domain() -> int:
    """ROS_DOMAIN_ID if set; otherwise one that this process reserves until it ends, so that no graph meets another.

    Raises
    ------
    LaunchError
        If ROS_DOMAIN_ID is no domain, or all are reserved.
    """
    require_domain(LaunchError)
    given = os.environ.get(DOMAIN)
    return int(given) if given else _reservation()[0]


@functools.cache
def _reservation() -> tuple[int, socket.socket]:
    for domain in range(1, 101):
        port = socket.socket()
        try:
            port.bind(("", RESERVING_PORTS + domain))
        except OSError:
            port.close()
        else:
            return domain, port
    raise LaunchError("the DDS domains 1 to 100 are in use by other sessions on this machine; set ROS_DOMAIN_ID")


class Graph:
    """The processes of a node graph.

    Parameters
    ----------
    nodes : sequence of NodeProcess
        What to start.
    env : mapping, optional
        Environment variables for all nodes in addition to the present ones, such as ROS_DOMAIN_ID.
    output : callable, optional
        Called with node name and text for every line that a node writes, from one thread per node.

    Attributes
    ----------
    processes : dict of str to subprocess.Popen
        The started processes by node name.
    """

    def __init__(
        self, nodes: Sequence[NodeProcess], env: Mapping[str, str] | None = None, output: Output | None = None
    ) -> None:
        self._nodes = {node.name: node for node in nodes}
        self._env = {**os.environ, "PYTHONUNBUFFERED": "1", **(env or {})}
        self._output = output
        self._lines: dict[str, deque[str]] = {name: deque(maxlen=KEPT_LINES) for name in self._nodes}
        self._readers: dict[str, threading.Thread] = {}
        self.processes: dict[str, subprocess.Popen[str]] = {}

    @classmethod
    def from_launch_file(
        cls,
        path: str | Path,
        arguments: Mapping[str, str] | None = None,
        env: Mapping[str, str] | None = None,
        output: Output | None = None,
    ) -> Graph:
        """The graph that a launch file describes; see `read_launch_file` for arguments and errors."""
        return cls(read_launch_file(path, arguments), env, output)

    def start(self) -> None:
        """Start all nodes.

        Raises
        ------
        LaunchError
            If a process cannot be started; those already started are stopped.
        """
        try:
            for name in self._nodes:
                self.start_node(name)
        except BaseException:
            self.stop()
            raise

    def start_node(self, name: str) -> None:
        """Start one node, for the first time or again after it has ended."""
        if name not in self._nodes:
            raise LaunchError(f"the graph has no node '{name}'; it has: {', '.join(self._nodes)}")
        if name in self.processes and self.processes[name].poll() is None:
            raise LaunchError(f"node '{name}' runs already")
        with interruptions.held_back():  # otherwise a process could run that `stop` does not know
            self._start(name)

    def _start(self, name: str) -> None:
        node = self._nodes[name]
        try:
            # In its own session: Ctrl-C in the terminal reaches only this process, which then ends the nodes.
            process = subprocess.Popen(
                node.command,
                env={**self._env, **node.env},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as problem:
            raise LaunchError(f"node '{name}' cannot be started: {problem}") from None
        self.processes[name] = process
        self._readers[name] = threading.Thread(target=self._forward, args=(name, process), daemon=True)
        self._readers[name].start()

    def ended(self) -> dict[str, int]:
        """Exit codes of the nodes that have ended (negative: the signal that killed the process)."""
        codes = {name: process.poll() for name, process in self.processes.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def check(self) -> None:
        """Raise `LaunchError` with name, exit code and last line of output if a node has ended."""
        for name, code in self.ended().items():
            self._readers[name].join(timeout=1.0)
            raise LaunchError(f"{describe_end(name, code)}; its last output: {self.last_line(name)}")

    def wait(self, timeout: float | None = None) -> dict[str, int]:
        """Wait until a node ends or `timeout` (s) is over; returns what `ended` returns."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while not (ended := self.ended()) and (deadline is None or time.monotonic() < deadline):
            time.sleep(POLL_PERIOD)
        return ended

    def stop(self) -> dict[str, int]:
        """End all nodes: SIGTERM, and SIGKILL for those that do not react. Returns the exit codes.

        Before a node is killed, it writes the stacks of its threads to its output. Ctrl-C during this leaves no node
        behind: the next signal is sent at once. What nodes that did not end by themselves leave in shared memory is
        removed.
        """
        running = [process for process in self.processes.values() if process.poll() is None]
        left = [path for process in running for path in shared_memory.owned(process.pid)]
        with interruptions.held_back() as interrupted:
            for number, patience in STOP_STAGES:
                self._end(number, patience, interrupted)
            interrupted.clear()
        if len(ended := self.ended()) == len(self.processes):
            shared_memory.remove(left)
        for reader in self._readers.values():
            reader.join(timeout=1.0)
        return ended

    def _end(self, number: signal.Signals, patience: float, interrupted: list[int]) -> None:
        """Send a signal to all running nodes and wait until they end, at most `patience` (s) or until Ctrl-C."""
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(number)
        deadline = time.monotonic() + patience
        interruptions_before = len(interrupted)
        while (
            len(self.ended()) < len(self.processes)
            and time.monotonic() < deadline
            and len(interrupted) == interruptions_before
        ):
            time.sleep(POLL_PERIOD)

    def lines(self, name: str) -> list[str]:
        """The last lines that a node wrote."""
        return list(self._lines[name])

    def last_line(self, name: str) -> str:
        """The last line that a node wrote, or `(nothing)`."""
        return self._lines[name][-1] if self._lines[name] else "(nothing)"

    def __enter__(self) -> Graph:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def _forward(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                text = line.rstrip()
                self._lines[name].append(text)
                if self._output is not None:
                    self._output(name, text)


def describe_end(name: str, code: int) -> str:
    """How a node ended, in words."""
    if code < 0:
        return f"node {name} was killed by {signal.Signals(-code).name}"
    return f"node {name} ended with exit code {code}"
