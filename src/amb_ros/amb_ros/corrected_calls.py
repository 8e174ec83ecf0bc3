"""Directs calls of loaded libraries to functions of our own: how faults of the middleware are corrected.

The middleware comes as a binary. Only calls of a library with a fault are changed, in the memory of this process; see
`corrected_calls.c`. Which faults these are say `overflowed_wait` and `unnoticed_arrival`.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import subprocess
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

from amb_core.ground.files.cache_folder import cache_folder

SOURCE = Path(__file__).with_suffix(".c")


def once(work: Callable[[], None]) -> Callable[[], None]:
    """A function that does work once in a process; a second thread waits until it is done."""
    lock, cached = threading.Lock(), functools.cache(work)

    def do() -> None:
        with lock:
            cached()

    return do


def loaded_libraries(*names: str) -> Iterator[tuple[Path, int]]:
    """Files of this process whose names begin like one of these, with the addresses of their beginnings."""
    for line in Path("/proc/self/maps").read_text().splitlines():
        span, _, offset, _, _, *rest = line.split(maxsplit=5)
        path = Path(*rest)
        if path.name.startswith(names) and int(offset, 16) == 0:
            yield path, int(span.partition("-")[0], 16)


def attempt(library: Path, harm: str, correct: Callable[[], None]) -> None:
    """Correct a library; where that is not possible, as without gcc, warn of the harm that it can do."""
    try:
        correct()
    except (OSError, RuntimeError, AttributeError, subprocess.SubprocessError) as problem:  # AttributeError: no symbol
        reason = getattr(problem, "stderr", None) or problem
        warnings.warn(f"{library} has a fault {harm}; it was not corrected: {reason}", stacklevel=4)


def require_found(count: int) -> None:
    """Raise RuntimeError if no call was directed."""
    if not count:
        raise RuntimeError("the call was not found in the memory of this process")


def functions() -> ctypes.CDLL:
    """The functions of `corrected_calls.c`; OSError or subprocess.SubprocessError if they cannot be built."""
    return ctypes.CDLL(str(build()))


def build() -> Path:
    """The library of these functions, built now if there is none of this source in the user's cache."""
    source = SOURCE.read_bytes()
    cache = cache_folder()
    library = cache / f"corrected_calls-{hashlib.sha256(source).hexdigest()[:16]}.so"
    if not library.exists():
        cache.mkdir(parents=True, exist_ok=True)
        made = library.with_suffix(f".{os.getpid()}")
        command = ["gcc", "-O2", "-Wall", "-shared", "-fPIC", "-o", str(made), str(SOURCE)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        made.replace(library)  # two processes may build it at the same time
    return library
