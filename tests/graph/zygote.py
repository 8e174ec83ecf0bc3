"""Starts nodes as forks of a process that has imported them: real processes, without a second of imports for each.

The process itself has no participant, no thread and no file but its connection. It imports a module when its first node
is asked for. What a node then does is what its executable does after its imports, in a process with arguments,
environment, folder and errors of its own. Tests about the start of a process start a new interpreter instead.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from amb_ros.startup import start

CHECK_FIELDS = "ROS_PYTHON_CHECK_FIELDS"
MOST = 1 << 18  # bytes of a request


class Zygote:
    """The process that forks, seen from the tests."""

    def __init__(self, check_fields: str) -> None:
        self._connection, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "tests.graph.zygote", str(other.fileno())]
        environment, root = os.environ | {CHECK_FIELDS: check_fields}, Path(__file__).parents[2]
        self._process = subprocess.Popen(command, pass_fds=[other.fileno()], env=environment, cwd=root)
        atexit.register(self.close)
        other.close()

    def fork(self, args: Sequence[str], errors: int, environment: Mapping[str, str], folder: Path) -> tuple[int, int]:
        """Start a module with arguments; its process, and a descriptor that yields its wait status at its end."""
        ended, end = os.pipe()
        request = [*args], dict(environment), str(folder)
        socket.send_fds(self._connection, [json.dumps(request).encode()], [errors, end])
        os.close(end)
        return int(self._connection.recv(MOST)), ended

    def close(self) -> None:
        """End it; nodes that it started go on."""
        self._connection.close()
        self._process.wait()


@functools.cache
def zygote(check_fields: str) -> Zygote:
    """The one whose nodes check the fields of messages (`1`) or do not: their modules read it as they are imported."""
    return Zygote(check_fields)


def serve(connection: socket.socket) -> list[str] | None:
    """Fork at every request until the connection ends; returns in each fork what to run."""
    running: dict[int, tuple[int, int]] = {}  # a pidfd: the process, and where its wait status is written
    with selectors.DefaultSelector() as selector:
        selector.register(connection, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fd in running:
                    process, end = running.pop(key.fd)
                    selector.unregister(key.fd)
                    os.write(end, str(os.waitpid(process, 0)[1]).encode())
                    os.close(end)
                    os.close(key.fd)
                    continue
                request, descriptors, _, _ = socket.recv_fds(connection, MOST, 2)
                if not request:
                    return None
                args, environment, folder = json.loads(request)
                errors, end = descriptors
                with contextlib.suppress(Exception):  # it is raised again where it belongs, in the fork
                    importlib.import_module(args[0])
                gc.freeze()  # forks share what is there as long as nobody writes to it
                process = os.fork()
                if process == 0:
                    os.dup2(errors, sys.stderr.fileno())
                    for descriptor in (errors, end, *running, *(other for _, other in running.values())):
                        os.close(descriptor)
                    connection.close()
                    os.environ.clear()
                    os.environ.update(environment)
                    os.chdir(folder)
                    sys.path[0] = folder  # as `python -m` has it
                    return list(args)
                os.close(errors)
                watched = os.pidfd_open(process)
                running[watched] = (process, end)
                selector.register(watched, selectors.EVENT_READ)
                connection.send(str(process).encode())


def main() -> int:
    """Serve the connection whose file descriptor is the argument; in a fork, run the node."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the tests
    args = serve(socket.socket(fileno=int(sys.argv[1])))
    if args is None:
        return 0
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = args
    return start(args[0])


if __name__ == "__main__":
    raise SystemExit(main())
