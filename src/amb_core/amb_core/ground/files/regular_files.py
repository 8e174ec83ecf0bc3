"""Opens files that a user or another program names: regular files of bounded size only, never a device or a pipe.

Opening a FIFO waits for its other end, and a device such as /dev/zero never ends: a node that gets such a path must
reject it at once. Every failure is an `OSError`; its `strerror` gives the reason in one line.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

MIB = 1 << 20
LONGEST_SHOWN = 200  # characters of a path in a message

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_regular(path: str | Path, limit: int | None = None) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path : str or Path
        The file.
    limit : int, optional
        Largest size allowed (bytes); any size if not given.

    Raises
    ------
    OSError
        If there is no such file, or it is not a regular file, too large or cannot be opened.
    """
    try:
        _check(Path(path).stat(), limit)  # before it is opened: opening alone can have an effect on a device
        # The file may have been exchanged since: do not wait for the writer of a pipe, and check again.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (ValueError, TypeError) as problem:  # a NUL in the path, or no path at all
        raise OSError(errno.EINVAL, f"the path is not allowed: {problem}") from None
    try:
        _check(os.fstat(descriptor), limit)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_text(path: str | Path, limit: int = MIB) -> str:
    """Content of a regular text file in UTF-8, with or without byte order mark.

    Raises
    ------
    OSError
        As `open_regular`, and if the content is not UTF-8.
    """
    with open_regular(path, limit) as file:
        content = file.read(limit + 1)  # a file that grows, or of /proc, is longer than its size
    if len(content) > limit:
        raise _too_large(limit)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        raise OSError(errno.EILSEQ, f"is not a text in UTF-8: {problem.reason} at byte {problem.start}") from None


def is_folder(path: str | Path) -> bool:
    """Whether there is a folder at a path; false if that cannot be determined."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):  # a path that is too long, or has a NUL
        return False


def shown(path: str | Path) -> str:
    """A path for a message: on one line, shortened if it is very long."""
    text = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in str(path))
    if len(text) <= LONGEST_SHOWN:
        return text
    half = LONGEST_SHOWN // 2
    return f"{text[:half]}...{text[-half:]}"


def _check(status: os.stat_result, limit: int | None) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        raise OSError(errno.EINVAL, f"is {_KINDS.get(kind, 'no file')}; a regular file is needed")
    if limit is not None and status.st_size > limit:
        raise _too_large(limit)


def _too_large(limit: int) -> OSError:
    size = f"{limit / MIB:g} MiB" if limit >= MIB else f"{limit} bytes"
    return OSError(errno.EFBIG, f"is too large; allowed: at most {size}")
