"""What is in a project's folder, by its content: bearings, maps, designs, experiments, models and certificates."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from amb_core.ground.errors import ParameterError, ProjectError
from amb_core.ground.files.parameter_files import ParameterFile
from amb_core.ground.files.regular_files import MIB, read_text, shown

_LARGEST = 64 * MIB  # of a JSON file
_DEEPEST = 5  # folders below the project's
_BAG = "metadata.yaml"


class Kind(StrEnum):
    """Kinds of items, in the order of the work."""

    BEARING = "bearing"
    MAP = "map"
    DESIGN = "design"
    EXPERIMENT = "experiment"
    MODEL = "model"
    CERTIFICATE = "certificate"


class State(StrEnum):
    """Whether an item is made from what is there now."""

    CURRENT = "current"
    STALE = "stale"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Item:
    """A file or bag of a project.

    Attributes
    ----------
    kind : Kind
        What it is.
    path : Path
        Where it is, relative to the project's folder.
    state : State
        Whether it is made from what is there now.
    reason : str
        Why it is stale or why that is not known; what else is worth knowing.
    content : mapping
        Of a JSON file.
    inputs : tuple of str
        Of a model: names of the files and bags that it was made from, as its summary records them.
    """

    kind: Kind
    path: Path
    state: State = State.CURRENT
    reason: str = ""
    content: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)
    inputs: tuple[str, ...] = ()


def find_items(folder: Path) -> list[Item]:
    """The items of a folder, by kind and name.

    Raises
    ------
    ProjectError
        If it is not a folder that can be read.
    """
    if not folder.is_dir():
        raise ProjectError(f"project {shown(folder)}: there is no such folder")
    items = [item for path in _paths(folder) if (item := _item(folder, path)) is not None]
    return sorted(items, key=lambda item: (list(Kind).index(item.kind), str(item.path)))


def _paths(folder: Path) -> Iterator[Path]:
    for place, folders, files in os.walk(folder):
        depth = len(Path(place).relative_to(folder).parts)
        folders[:] = [] if depth >= _DEEPEST else sorted(name for name in folders if not name.startswith("."))
        if _BAG in files:
            folders.clear()
            files = [_BAG]
        yield from (Path(place) / name for name in sorted(files))


def _item(folder: Path, path: Path) -> Item | None:
    relative = path.relative_to(folder)
    if path.name == _BAG:
        return Item(Kind.EXPERIMENT, relative.parent)
    if path.suffix in (".yaml", ".yml"):
        return Item(Kind.BEARING, relative) if len(relative.parts) == 1 and _is_bearing(path) else None
    if path.suffix != ".json":
        return None
    try:
        content = json.loads(read_text(path, _LARGEST))
    except (OSError, ValueError, RecursionError):
        return None  # not a file of ours
    kind = _kind(content) if isinstance(content, dict) else None
    return None if kind is None else Item(kind, relative, content=content)


def _is_bearing(path: Path) -> bool:
    try:
        return bool(ParameterFile(path).values("simulator"))
    except ParameterError:
        return False


def _kind(content: Mapping[str, Any]) -> Kind | None:
    marks = {
        Kind.MAP: ("provenance", "settings", "sweeps"),
        Kind.DESIGN: ("parameters", "largest_amplitude", "limited_by"),
        Kind.MODEL: ("a", "b", "c", "k", "innovation_covariance", "sample_time"),
        Kind.CERTIFICATE: ("certified", "checks", "inputs"),
    }
    return next((kind for kind, names in marks.items() if all(name in content for name in names)), None)
