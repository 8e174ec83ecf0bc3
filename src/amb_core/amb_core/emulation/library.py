"""The reference target as a library of this checkout: `python -m amb_core.emulation.library` builds it."""

from __future__ import annotations

import sys
from pathlib import Path

from amb_core.errors import TargetError
from amb_core.target import build_library
from amb_core.target.reference import SOURCE

LIBRARY = SOURCE.parent / "build" / "target" / "libamb_target.so"
"""Where set-up builds it; it is built again when its sources are newer."""


def reference_library() -> Path:
    """The library, built now if it is missing or older than its sources.

    Raises
    ------
    TargetError
        If it cannot be built.
    """
    try:
        return build_library(LIBRARY)
    except OSError as problem:
        raise TargetError(f"{LIBRARY} cannot be written: {problem.strerror}") from None


def main() -> int:
    """Build it; returns the exit code."""
    try:
        reference_library()
    except TargetError as problem:
        print(problem, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
