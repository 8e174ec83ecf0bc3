"""Reads files of others apart: in a child process with limits of memory and time, from which only plain data come back.

Libraries of file formats are large and written in C; a damaged or hostile file can crash them, or take all memory. One
server process for each process that reads files is started at its first file, `amb_core.ground.files.apart_server`.
For each file the server forks a child, which can open no file for writing. The end of the child is an error of that
file, and nothing else.
"""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import amb_core.ground.errors
from amb_core.ground.errors import AmbError
from amb_core.ground.files.limits import limits_for
from amb_core.ground.files.plain_data import HEAD, decode
from amb_core.ground.files.regular_files import MIB

_PROGRAM = "from amb_core.ground.files.apart_server import main; main()"


class UnreadableError(Exception):
    """What a library has raised for a file in the child; its text gives the reason."""


class Apart:
    """An object in a child process whose methods read one file.

    Parameters
    ----------
    target : str
        What makes it, as `module:function` or `module:Class`.
    path : path
        The file, the first argument of the target.
    *arguments
        Further arguments, plain data.
    modules : sequence of str, optional
        Modules that the server imports for all children to come.
    """

    def __init__(self, target: str, path: str | Path, *arguments: Any, modules: Sequence[str] = ()) -> None:
        self._limits = limits_for(path)
        self._channel = _server.new_child(
            {
                "target": target,
                "arguments": [os.fspath(path), *arguments],
                "folder": str(Path.cwd()),
                "modules": list(modules),
                "limits": asdict(self._limits),
            }
        )
        self._channel.settimeout(self._limits.longest_wait + 5.0)
        self._result = self._answer(False)

    @property
    def result(self) -> Any:
        """What a function as target has returned; None for an object."""
        return self._result

    def call(self, method: str, *arguments: Any, as_objects: bool = False) -> Any:
        """What a method returns.

        Raises
        ------
        AmbError, OSError, UnreadableError
            What it raises; OSError also if the child ends, for it needs more than it may.
        """
        self._send([method, *arguments])
        return self._answer(as_objects)

    def iterate(self, method: str, *arguments: Any, as_objects: bool = False) -> Iterator[Any]:
        """The items that a method yields, each made when it is asked for; errors as for `call`."""
        self.call(method, *arguments)
        while (batch := self.call("next", as_objects=as_objects)) is not None:
            yield from batch

    def close(self) -> None:
        """End the child."""
        self._channel.close()

    def _send(self, call: list[Any]) -> None:
        try:
            text = json.dumps(call).encode()
            self._channel.sendall(len(text).to_bytes(8, "little") + text)
        except OSError:
            raise self._ended() from None

    def _answer(self, as_objects: bool) -> Any:
        text_length, length = HEAD.unpack(self._received(HEAD.size))
        if text_length > self._limits.texts + MIB or length > self._limits.values:
            raise self._ended()
        text = bytes(self._received(text_length))
        try:
            kind, value = decode(text, self._received(length), as_objects)
        except (ValueError, TypeError, RecursionError):
            raise self._ended() from None
        if kind == "error":
            raise _error_of(*value)
        return value

    def _received(self, length: int) -> bytearray:
        content = bytearray(length)
        view, done = memoryview(content), 0
        while done < length:
            try:
                got = self._channel.recv_into(view[done:])
            except OSError:  # also a timeout
                got = 0
            if not got:
                raise self._ended()
            done += got
        return content

    def _ended(self) -> OSError:
        self.close()
        memory, seconds = self._limits.memory // MIB, self._limits.seconds
        return OSError(
            errno.EIO,
            f"the process that read it has ended; it is damaged, or needs more than {memory} MiB or {seconds:.0f} s",
        )


def read_apart(target: str, path: str | Path, *arguments: Any, modules: Sequence[str] = ()) -> Any:
    """What a function returns for a file; errors as for `Apart.call`."""
    apart = Apart(target, path, *arguments, modules=modules)
    apart.close()
    return apart.result


def _error_of(kind: str, number: int, text: str) -> Exception:
    """The error of a child: one of the workbench, of the system, or of a library."""
    known = getattr(amb_core.ground.errors, kind, None)
    if isinstance(known, type) and issubclass(known, AmbError):
        return known(text)
    return OSError(number, text) if kind == "OSError" else UnreadableError(text)


class _Server:
    """The server of this process, started when it is first needed and again if it has ended."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._owner = 0
        self._control: socket.socket | None = None
        self._process: subprocess.Popen[bytes] | None = None

    def new_child(self, request: dict[str, Any]) -> socket.socket:
        """A channel to a new child.

        Raises
        ------
        OSError
            If the server cannot be started.
        """
        ours, its = socket.socketpair()
        text = json.dumps(request).encode()
        with self._lock, its:
            if self._control is None or self._owner != os.getpid():
                self._start()
            try:
                self._hand_over(text, its)
            except (BrokenPipeError, ConnectionError):
                self._start()
                self._hand_over(text, its)
        return ours

    def _hand_over(self, text: bytes, channel: socket.socket) -> None:
        assert self._control is not None
        socket.send_fds(self._control, [text], [channel.fileno()])

    def _start(self) -> None:
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with its:
            if self._process is not None and self._owner == os.getpid():
                self._process.poll()
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM, str(its.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[its.fileno()],
                start_new_session=True,  # Ctrl-C is for the process that asks
            )
        self._control, self._owner = ours, os.getpid()


_server = _Server()
