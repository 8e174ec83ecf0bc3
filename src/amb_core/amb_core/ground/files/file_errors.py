"""Errors of reading a file, as one line with the file name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.regular_files import shown


@contextmanager
def reading(what: str, path: Path) -> Iterator[None]:
    """Turn every error of the block into an IdentificationError that begins with `what` and the path.

    The parsers of zip, JSON, text, NumPy and MATLAB files all raise different errors for a damaged file.
    """
    name = shown(path)
    try:
        yield
    except IdentificationError as problem:
        problem.args = (f"{what} {name}: {problem}",)
        raise
    except OSError as problem:
        raise IdentificationError(f"{what} {name}: cannot be read: {problem.strerror or problem}") from None
    except Exception as problem:
        reason = " ".join(str(problem).split()) or type(problem).__name__
        raise IdentificationError(f"{what} {name}: is damaged or of another kind: {reason}") from None
