"""How much a file may ask of its reader: bytes when decompressed, numbers, memory, seconds and depth.

One budget for all kinds of files. Each part has a floor for small files and grows with the size of the file, so a large
recording is read, and a small file that expands to gigabytes is refused.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path

from amb_core.ground.files.regular_files import MIB

DEEPEST = 32
"""Levels of structs, cells, groups or lists within each other."""
MOST_COLUMNS = 4096
"""Columns of a table."""
MOST_ITEMS = 20_000
"""Items of all cells and structs of a MATLAB file, each as often as it is referred to."""
LONGEST_LINE = MIB
"""Longest line of a text table (B)."""


@dataclass(frozen=True)
class ReadLimits:
    """What the reader of a file may use.

    Attributes
    ----------
    expanded : int
        Bytes of the content when decompressed.
    values : int
        Bytes of the numbers that are returned, eight for each.
    texts : int
        Bytes of everything else that is returned.
    memory : int
        Memory that the reading process may allocate (B).
    seconds : float
        Processor time of one answer (s).
    """

    expanded: int
    values: int
    texts: int
    memory: int
    seconds: float

    @property
    def longest_wait(self) -> float:
        """Wall-clock time of one answer (s); a loaded machine gives a process a part of its time."""
        return 8.0 * self.seconds


def limits_for(path: str | Path) -> ReadLimits:
    """The limits of a file, or of a folder with the files in it."""
    size = size_of(path)
    return ReadLimits(
        expanded=max(256 * MIB, 64 * size),
        values=max(128 * MIB, 32 * size),
        texts=max(16 * MIB, 16 * size),
        memory=512 * MIB + 32 * size,
        seconds=6.0 + 4.0 * size / MIB,
    )


def size_of(path: str | Path) -> int:
    """Size of a file, or of the files of a folder (B); 0 for what cannot be determined."""
    try:
        status = Path(path).stat()
        if not Path(path).is_dir():
            return status.st_size
        return sum(item.stat().st_size for item in Path(path).iterdir() if item.is_file())
    except (OSError, ValueError):
        return 0


class Expansion:
    """Counts the bytes of a file as they are decompressed.

    Parameters
    ----------
    limit : int
        Most bytes allowed.
    """

    def __init__(self, limit: int) -> None:
        self._limit = self._left = limit

    @property
    def left(self) -> int:
        """Bytes that may still come."""
        return self._left

    def take(self, number: int) -> None:
        """Count bytes before they are decompressed; OSError if they are too many."""
        if number > self._left:
            raise too_much(f"expands to more than {self._limit // MIB} MiB")
        self._left -= number


class Items:
    """Counts items of nested data, and refuses too many of them, or too deep ones.

    Attributes
    ----------
    taken : int
        Items so far.
    """

    def __init__(self) -> None:
        self.taken = 0

    def take(self, depth: int, number: int = 1) -> None:
        """Count an item at a depth, or that many at and below it; OSError if it is too much."""
        self.taken += number
        if self.taken > MOST_ITEMS:
            raise too_much(f"has more than {MOST_ITEMS} items")
        if depth > DEEPEST:
            raise too_much(f"is nested deeper than {DEEPEST} levels")


def too_much(reason: str) -> OSError:
    """The error of a file that asks for more than its limits."""
    return OSError(errno.EFBIG, f"{reason}, which is not allowed for a file of its size")
