"""The process that forks a child for each file that is read apart; see `amb_core.ground.files.apart`."""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import FunctionType
from typing import Any

from amb_core.ground.errors import AmbError
from amb_core.ground.files.limits import ReadLimits, too_much
from amb_core.ground.files.plain_data import Encoder
from amb_core.ground.files.regular_files import MIB

_REQUEST = 256 * 1024  # longest request (B)
_BATCH = 64  # items in one answer of an iterator


def main() -> int:
    """Serve the control channel in the first argument until the other side closes it."""
    control = socket.socket(fileno=int(sys.argv[1]))
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no child is waited for
    while True:
        text, descriptors, _, _ = socket.recv_fds(control, _REQUEST, 1)
        if not text:
            return 0
        request = json.loads(text)
        for module in (*request["modules"], request["target"].partition(":")[0]):
            with suppress(Exception):  # the child raises it again, as the error of its file
                importlib.import_module(module)
        if os.fork() == 0:
            control.close()
            _serve(socket.socket(fileno=descriptors[0]), request)
        os.close(descriptors[0])


def seal() -> None:
    """Let this process open no further file, if it is a child of the server; what is open stays open.

    For libraries that may follow references of a file to other files.
    """
    if _inside:
        first_free = os.dup(2)
        os.close(first_free)
        _lower(resource.RLIMIT_NOFILE, first_free)


_inside = False


def _serve(channel: socket.socket, request: dict[str, Any]) -> None:
    """The life of a child."""
    global _inside  # set once, after the fork
    try:
        _inside = True
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with suppress(OSError):  # relative paths are those of the process that asks
            os.chdir(request["folder"])
        limits = ReadLimits(**request["limits"])
        _confine(limits)
        made: list[Any] = []
        _answer(channel, limits, Encoder(limits), lambda: _made(request, made))
        items: Iterator[Any] | None = None
        encoder = Encoder(limits)
        while made and (call := _received(channel)):
            method, *arguments = call
            if method == "next":
                _answer(channel, limits, encoder, lambda items=items: _batch(items))  # type: ignore[misc]
                continue
            encoder = Encoder(limits)
            items, bound = None, getattr(made[0], method)
            if getattr(bound, "yields", False):
                items = iter(bound(*arguments))
                _answer(channel, limits, encoder, lambda: None)
            else:
                _answer(channel, limits, encoder, lambda bound=bound, a=arguments: bound(*a))  # type: ignore[misc]
    finally:
        os._exit(0)


def yields(method: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
    """Mark a method whose items are asked for one batch after the other."""
    method.yields = True  # type: ignore[attr-defined]
    return method


def _made(request: dict[str, Any], made: list[Any]) -> Any:
    """The result of a function; None for an object, which is kept."""
    module, _, name = request["target"].partition(":")
    target = getattr(importlib.import_module(module), name)
    result = target(*request["arguments"])
    if isinstance(target, FunctionType):
        return result
    made.append(result)
    return None


def _batch(items: Iterator[Any] | None) -> list[Any] | None:
    batch = []
    for item in items or ():
        batch.append(item)
        if len(batch) == _BATCH:
            break
    return batch or None


def _confine(limits: ReadLimits) -> None:
    """No file is written, no core is left, and memory is limited beyond what the process has now."""
    for number in (resource.RLIMIT_FSIZE, resource.RLIMIT_CORE):
        _lower(number, 0)
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
        now = int(file.read().split()[0]) * resource.getpagesize()
    _lower(resource.RLIMIT_AS, now + limits.memory)


def _lower(number: int, limit: int) -> None:
    """Limit a resource for good, or as the user has, if that is less: no limit may be raised."""
    limit = _at_most(limit, *resource.getrlimit(number))
    resource.setrlimit(number, (limit, limit))


def _at_most(limit: int, *others: int) -> int:
    """The least of several limits."""
    return min(limit, *(other for other in (limit, *others) if other != resource.RLIM_INFINITY))


def _answer(channel: socket.socket, limits: ReadLimits, encoder: Encoder, action: Callable[[], Any]) -> None:
    """Send what an action returns or raises. The kernel ends a process that takes too long."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    allowed = int(usage.ru_utime + usage.ru_stime + limits.seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (_at_most(allowed, hard), hard))
    signal.setitimer(signal.ITIMER_REAL, limits.longest_wait)
    try:
        parts = encoder.encode(["value", action()])
    except MemoryError:
        parts = _error("OSError", too_much(f"needs more than {limits.memory // MIB} MiB of memory"))
    except AmbError as problem:
        parts = _error(type(problem).__name__, problem)
    except OSError as problem:
        parts = _error("OSError", problem)
    except RecursionError:
        parts = _error("OSError", too_much("is nested too deeply"))
    except Exception as problem:
        parts = _error("", problem)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for part in parts:
        channel.sendall(part)


def _error(kind: str, problem: Exception) -> list[bytes | memoryview]:
    number, text = 0, str(problem) or type(problem).__name__
    if isinstance(problem, OSError):
        number, text = problem.errno or 0, problem.strerror or str(problem)
    return Encoder(ReadLimits(0, 0, 1 << 20, 0, 0.0)).encode(["error", [kind, number, text[:10_000]]])


def _received(channel: socket.socket) -> Any:
    """The next call; None at the end."""
    length = channel.recv(8, socket.MSG_WAITALL)
    return json.loads(channel.recv(int.from_bytes(length, "little"), socket.MSG_WAITALL)) if length else None
