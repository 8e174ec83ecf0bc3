"""Outcomes of a long measurement, kept one by one, so that it resumes after an interruption of the same code."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from tests.front_door.results import ROOT

T = TypeVar("T")


class KeptOutcomes(Generic[T]):
    """A file with an outcome in each line.

    Parameters
    ----------
    file : Path or None
        The file; it need not exist. None to keep nothing.
    code : str
        What made the outcomes, by `computing_code` or `checkout`; those of other code do not count.
    encode, decode : callable
        An outcome as data of JSON, and back.
    """

    def __init__(
        self,
        file: Path | None,
        code: str,
        encode: Callable[[T], dict[str, Any]],
        decode: Callable[[dict[str, Any]], T],
    ) -> None:
        self._file, self._code, self._encode, self._decode = file, code, encode, decode

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

    def forget(self) -> None:
        """Drop those of this code; those of other code, as of other tests, stay."""
        if self._file is None or not self._file.exists():
            return
        of_ours = f'{{"code": {json.dumps(self._code)}, '
        lines = self._file.read_text().splitlines(keepends=True)
        self._file.write_text("".join(line for line in lines if not line.startswith(of_ours)))


def computing_code(module: Path) -> str:
    """Of what amb_core, the C target and a module compute."""
    from amb_core.ground.tasks.provenance import code_version
    from amb_core.rig.link.reference import SOURCE

    digest = hashlib.sha256(code_version().encode() + module.read_bytes())
    for source in sorted(SOURCE.rglob("*.[ch]")):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def checkout() -> str:
    """Commit of this checkout, with a checksum behind it where tracked files differ; empty where there is none."""

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout

    try:
        commit, changes = git("rev-parse", "--short=12", "HEAD").strip(), git("diff", "HEAD")
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{commit}+{hashlib.sha256(changes.encode()).hexdigest()[:12]}" if changes else commit
