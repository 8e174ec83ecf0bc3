"""Folders and files for the results of commands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from amb_core.ground.errors import AmbError
from amb_core.ground.files.regular_files import is_folder, shown
from amb_core.ground.files.whole_files import whole_file
from amb_core.ground.results import VERSION, plain


class ResultError(AmbError):
    """Results cannot be written to the requested place."""


def make_folder(out: Path) -> None:
    """Make the folder of results before the work starts; ResultError if that fails or nothing can be written there."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise ResultError(f"folder {shown(out)}: cannot be made: there is a file of this name") from None
    except OSError as problem:
        raise ResultError(f"folder {shown(out)}: cannot be made: {problem.strerror}") from None
    except ValueError as problem:  # a NUL in the path
        raise ResultError(f"folder {shown(out)}: cannot be made: {problem}") from None
    try:
        with TemporaryFile(dir=out):
            pass
    except OSError as problem:
        raise ResultError(f"folder {shown(out)}: cannot be written to: {problem.strerror}") from None


def names_file(out: Path, endings: Sequence[str]) -> bool:
    """Whether --out names a file for the main result only (by its ending) and not a folder for all results.

    Raises
    ------
    ResultError
        If it has the ending of another kind of file.
    """
    if is_folder(out) or not out.suffix:
        return False
    if out.suffix.lower() not in endings:
        raise ResultError(
            f"{shown(out)}: the name must end in {', '.join(endings)} for a file, or have no ending for a folder"
        )
    return True


def make_place(path: Path, endings: Sequence[str] = (".json",)) -> None:
    """Make the folder of a result file before the work starts; ResultError if that fails or the ending is wrong."""
    if path.suffix.lower() not in endings:
        raise ResultError(f"{path}: the file name must end in {', '.join(endings)}")
    make_folder(path.parent)


@contextmanager
def new_file(path: Path, overwrite: bool = False) -> Iterator[Path]:
    """Give the path to write to; the file has its name only if the block ends without an exception.

    Raises
    ------
    ResultError
        If there is a file of this name that is not to be overwritten, or it cannot be written.
    """
    try:
        with whole_file(path, overwrite) as part:
            yield part
    except FileExistsError:
        raise ResultError(f"{path}: exists already; give another name, or --overwrite") from None
    except OSError as problem:
        raise ResultError(f"{path}: cannot be written: {problem.strerror or problem}") from None


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a result as JSON that every reader accepts; ResultError if the file cannot be written."""
    try:
        path.write_text(json.dumps({"version": VERSION, **plain(content)}, indent=2, allow_nan=False) + "\n")
    except OSError as problem:
        raise ResultError(f"{path}: cannot be written: {problem.strerror}") from None
