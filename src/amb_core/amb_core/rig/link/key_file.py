"""The shared key of host and target, from a file that nobody but its owner can read."""

from __future__ import annotations

import os
from pathlib import Path

from amb_core.ground.errors import TargetError
from amb_core.ground.files.regular_files import open_regular, shown
from amb_core.rig.link.frames import require_key

_LARGEST_FILE = 1024  # bytes


def read_key(path: str | Path) -> bytes:
    """Key from a file with its bytes in hexadecimal digits; `openssl rand -hex 32` makes one.

    Raises
    ------
    TargetError
        If the file cannot be read, others than its owner may read or change it, or it holds no key.
    """
    where = f"key file {shown(path)}"
    try:
        with open_regular(path, _LARGEST_FILE) as file:
            mode = os.fstat(file.fileno()).st_mode & 0o777
            text = file.read(_LARGEST_FILE + 1)
    except OSError as problem:
        raise TargetError(f"{where}: cannot be read: {problem.strerror}") from None
    if mode & 0o077:
        raise TargetError(f"{where} has mode {mode:04o}; allowed: 0600 (run: chmod 600 {shown(path)})")
    try:
        key = bytes.fromhex(text.decode())
    except ValueError:  # UnicodeDecodeError too
        raise TargetError(f"{where}: is not in hexadecimal digits; make one by: openssl rand -hex 32") from None
    if not key:
        raise TargetError(f"{where}: is empty; make one by: openssl rand -hex 32")
    try:
        require_key(key)
    except TargetError as problem:
        raise TargetError(f"{where}: {problem}") from None
    return key
