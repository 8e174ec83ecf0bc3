"""Files that are there in whole or not at all: written beside their place, and moved there when they are complete."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def whole_file(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """Give the path to write to; the file has its final name only if the block ends without an exception.

    After an error, or Ctrl-C, nothing new is left, and a file of before is as it was.

    Raises
    ------
    OSError
        If there is a file already and it is not to be overwritten, or the file cannot be moved to its place.
    """
    if not overwrite and path.exists():
        raise FileExistsError(errno.EEXIST, "exists already", str(path))
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")  # writers look at the ending
    try:
        yield part
        if overwrite:
            part.replace(path)
        else:
            os.link(part, path)  # fails if somebody has made a file of this name meanwhile; a move would replace it
    finally:
        with suppress(FileNotFoundError):
            part.unlink()
