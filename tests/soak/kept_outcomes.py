"""Outcomes of a long measurement, kept one by one, so that it resumes after an interruption of the same code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from amb_core.ground.tasks.provenance import code_version
from amb_core.rig.link.reference import SOURCE

T = TypeVar("T")


class KeptOutcomes(Generic[T]):
    """A file with an outcome in each line.

    Parameters
    ----------
    file : Path or None
        The file; it need not exist. None to keep nothing.
    code : Path
        The module that makes the outcomes; they count while it, amb_core and the C target are as they were.
    encode, decode : callable
        An outcome as data of JSON, and back.
    """

    def __init__(
        self,
        file: Path | None,
        code: Path,
        encode: Callable[[T], dict[str, Any]],
        decode: Callable[[dict[str, Any]], T],
    ) -> None:
        self._file, self._encode, self._decode = file, encode, decode
        digest = hashlib.sha256(code_version().encode() + code.read_bytes())
        for source in sorted(SOURCE.rglob("*.[ch]")):
            digest.update(source.read_bytes())
        self._code = digest.hexdigest()

    def load(self) -> list[T]:
        """Those of this code; a line that was cut by an interruption is left out."""
        if self._file is None or not self._file.exists():
            return []
        outcomes = []
        for line in self._file.read_text().splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            if row["code"] == self._code:
                outcomes.append(self._decode(row["outcome"]))
        return outcomes

    def add(self, outcome: T) -> None:
        """Keep one."""
        if self._file is None:
            return
        line = json.dumps({"code": self._code, "outcome": self._encode(outcome)})
        with self._file.open("a") as file:
            file.write(f"\n{line}\n")  # a line that was cut does not take this one with it
