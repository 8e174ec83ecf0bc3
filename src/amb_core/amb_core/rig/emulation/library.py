"""The reference target as a library: built from the C code of the checkout, or from the copy that is installed.

Set-up builds it once; whoever needs it builds it again when its sources are newer.
"""

from __future__ import annotations

import sys
from pathlib import Path

from amb_core.ground.errors import TargetError
from amb_core.ground.files.cache_folder import cache_folder
from amb_core.rig.link import build_library
from amb_core.rig.link.reference import SOURCE

_NAME = "libamb_target.so"


def reference_library() -> Path:
    """The library, built now if it is missing or older than its sources.

    Returns
    -------
    Path
        File of the shared library.

    Raises
    ------
    TargetError
        If it cannot be built.
    """
    try:
        return build_library(_folder() / _NAME)
    except OSError as problem:
        raise TargetError(f"the library of the reference target cannot be built: {problem}") from None


def _folder() -> Path:
    """Beside the other builds of a checkout; else in the user's cache, since an installation may be read-only."""
    if SOURCE.is_symlink():
        return SOURCE.resolve().parent / "build" / "target"
    return cache_folder("target")


def main() -> int:
    """Build it; returns the exit code."""
    try:
        reference_library()
    except TargetError as problem:
        print(problem, file=sys.stderr)
        return 1
    return 0
