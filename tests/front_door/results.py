"""Where programs write their figures: results, and results/quick those of the smallest size.

A program writes NAME.json part by part, and beside it NAME.measured.json: the code, machine and date of each part.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, TypeAdapter

ROOT = Path(__file__).parents[2]
Place = tuple[str, ...]
"""A key of a file of results, or a key and one of those below it."""


def results_file(name: str, quick: bool = False) -> Path:
    """The file of a program, in a folder that exists; see `tests.front_door.entries` for what it must hold."""
    folder = ROOT / "results" / "quick" if quick else ROOT / "results"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name


class Stamp(BaseModel):
    """Where and when a part of a file of results was measured.

    Attributes
    ----------
    commit : str
        Of this checkout when the program started; empty where there is none.
    changed : list of str
        Files that differed from that commit, or were not known to git, when it started or when the part was done.
    machine, date : str
        Processor and cores; day.
    wrote : list of tuple
        Its keys in the file.
    """

    model_config = ConfigDict(extra="forbid")

    commit: str
    changed: list[str]
    machine: str
    date: str
    wrote: list[Place]


_STAMPS = TypeAdapter(dict[str, Stamp])


class Results:
    """A file of results, to which a program adds part by part.

    Parameters
    ----------
    name : str
        Of the file; parts of earlier runs that are in it stay.
    quick : bool, optional
        Whether it is that of the smallest size.

    Attributes
    ----------
    file : Path
        The file.
    figures : object
        What is in it.
    """

    def __init__(self, name: str, quick: bool = False) -> None:
        self.file = results_file(name, quick)
        self.figures: Any = json.loads(self.file.read_text()) if self.file.exists() else {}
        self._stamps = stamps_of(self.file)
        self._commit = _git("rev-parse", "HEAD").strip()
        self._changed = set(_differing(self._commit))

    def keep(self, part: str, figures: dict[str, Any]) -> None:
        """Put the figures of a part in the place of those that it wrote before; keys of other parts stay.

        Parameters
        ----------
        part : str
            Its name in the program.
        figures : dict
            Keys of the file. Below a key other parts may have keys of their own.
        """
        earlier = self._stamps.pop(part, None)
        written = list(_places(figures))
        for stamp in self._stamps.values():
            stamp.wrote = [place for place in stamp.wrote if place not in written]
        replaced = {place for place in _places(self.figures) if place[0] in figures}
        replaced |= set(earlier.wrote if earlier else ())
        self.figures = _only(self.figures, set(_places(self.figures)) - replaced | self._written())
        for key, value in figures.items():
            below = self.figures.get(key)
            self.figures[key] = below | value if isinstance(below, dict) and isinstance(value, dict) else value
        self._stamp(part, written)

    def keep_all(self, figures: Any) -> None:
        """Put figures in the place of all that is in the file."""
        self.figures, self._stamps = figures, {}
        self._stamp("all", [()])

    def skip(self, part: str, reason: str) -> None:
        """Note why a part, of its own key, cannot be measured here; what was measured of it before stays."""
        if set(self.figures.get(part, {"skipped": ""})) == {"skipped"}:
            self.keep(part, {part: {"skipped": reason}})

    def drop_others(self, parts: Iterable[str]) -> None:
        """Drop what none of these parts wrote, as of a part that there is no longer; a full run ends with it."""
        self._stamps = {part: self._stamps[part] for part in parts if part in self._stamps}
        self.figures = _only(self.figures, self._written())
        self._save()

    def _written(self) -> set[Place]:
        return {place for stamp in self._stamps.values() for place in stamp.wrote}

    def _stamp(self, part: str, wrote: list[Place]) -> None:
        changed = sorted(self._changed | set(_differing(self._commit)))
        self._stamps[part] = Stamp(
            commit=self._commit, changed=changed, machine=machine(), date=str(date.today()), wrote=wrote
        )
        self._save()

    def _save(self) -> None:
        self.file.write_text(json.dumps(self.figures, indent=2) + "\n")
        stamps_file(self.file).write_bytes(_STAMPS.dump_json(self._stamps, indent=1) + b"\n")


def stamps_file(file: Path) -> Path:
    """Beside a file of results, when and where its parts were measured."""
    return file.with_suffix(".measured.json")


def stamps_of(file: Path) -> dict[str, Stamp]:
    """When and where the parts of a file of results were measured, as far as it is known."""
    beside = stamps_file(file)
    return _STAMPS.validate_json(beside.read_text()) if file.exists() and beside.exists() else {}


def unstamped(file: Path) -> list[str]:
    """Keys of a file of results of which it is not known on which code they were measured."""
    known = {place for stamp in stamps_of(file).values() for place in stamp.wrote}
    if () in known:
        return []
    return list(dict.fromkeys(place[0] for place in _places(json.loads(file.read_text())) if place not in known))


def processor() -> str:
    """Name of the processor."""
    named = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return named[1] if named else platform.processor()


def machine() -> str:
    """Processor and cores."""
    return f"{processor()}, {os.cpu_count()} cores"


def _places(figures: dict[str, Any]) -> Iterator[Place]:
    for key, value in figures.items():
        if isinstance(value, dict) and value:
            yield from ((key, below) for below in value)
        else:
            yield (key,)


def _only(figures: dict[str, Any], places: set[Place]) -> dict[str, Any]:
    """Figures without what is at no place of these."""
    kept: dict[str, Any] = {}
    for place in _places(figures):
        if place not in places:
            continue
        key, *below = place
        if below:
            kept.setdefault(key, {})[below[0]] = figures[key][below[0]]
        else:
            kept[key] = figures[key]
    return kept


def _differing(commit: str) -> list[str]:
    """Files that differ from a commit, and those that git neither knows nor ignores."""
    return [
        *_git("diff", "--name-only", "--no-renames", commit).splitlines(),
        *_git("ls-files", "--others", "--exclude-standard").splitlines(),
    ] if commit else []  # fmt: skip


def _git(*words: str) -> str:
    """What git prints in this checkout; nothing where there is none."""
    try:
        return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return ""
