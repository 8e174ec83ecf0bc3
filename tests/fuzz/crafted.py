"""The list of crafted files, and the secret beside them that none may show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

SECRET = b"SECRET-4711-"
"""What the file beside the crafted ones holds; whoever reads it has read elsewhere."""
GIB = 1 << 30
LOOP = "amb_msgs/msg/LoopSamples"

CRAFTED: dict[str, Callable[[Path], None]] = {}
"""Makers of a file or folder at a path, by its name."""


def crafted(name: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    """Add a maker."""

    def add(make: Callable[[Path], None]) -> Callable[[Path], None]:
        CRAFTED[name] = make
        return make

    return add


def make_secret(folder: Path) -> Path:
    """The file that nobody may read: numbers that spell the secret."""
    path = folder / "secret.bin"
    path.write_bytes(SECRET * 400)
    return path
