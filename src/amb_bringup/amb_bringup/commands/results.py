"""Where commands leave their results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from amb_core.errors import AmbError


class ResultError(AmbError):
    """Results cannot be written where they were asked for."""


def make_folder(out: Path) -> None:
    """Make the folder of results: before the work, not after; ResultError if that fails."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ResultError(f"folder {out}: cannot be made: {problem.strerror}") from None


def make_place(path: Path, endings: Sequence[str] = (".json",)) -> None:
    """Make the folder of a file of results: before the work; ResultError if that fails or the name ends otherwise."""
    if path.suffix.lower() not in endings:
        raise ResultError(f"{path}: the file name must end in {', '.join(endings)}")
    make_folder(path.parent)


def write_json(path: Path, content: Any) -> None:
    """Write JSON that every reader takes, without NaN; ResultError if the file cannot be written."""
    try:
        path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
    except OSError as problem:
        raise ResultError(f"{path}: cannot be written: {problem.strerror}") from None
    except ValueError as problem:  # NaN or infinity
        raise ResultError(f"{path}: cannot be written: {problem}") from None
