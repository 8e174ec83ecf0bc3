"""The shared key of host and target, in a file that nobody else can read."""

from __future__ import annotations

import stat
from pathlib import Path

from amb_core.errors import TargetError
from amb_core.target.frames import require_key

ALLOWED = "32 to 128 hexadecimal digits in a file of mode 0600; make one: (umask 077; openssl rand -hex 32 > FILE)"


def read_key(path: str | Path) -> bytes:
    """The key in a file, in hexadecimal digits; an empty path is no key.

    Raises
    ------
    TargetError
        If the file cannot be read, can be read or written by others, or holds no key.
    """
    if not str(path):
        return b""
    file = Path(path).expanduser()
    try:
        mode = file.stat().st_mode
        text = file.read_text(encoding="ascii", errors="replace").strip()
    except OSError as problem:
        raise TargetError(f"key file {file} cannot be read: {problem.strerror}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise TargetError(f"key file {file} has mode {stat.S_IMODE(mode):04o}; others can use it; allowed: 0600")
    try:
        key = bytes.fromhex(text)
        require_key(key)
    except (ValueError, TargetError):
        raise TargetError(f"key file {file} does not hold a key; allowed: {ALLOWED}") from None
    if not key:
        raise TargetError(f"key file {file} is empty; allowed: {ALLOWED}")
    return key
