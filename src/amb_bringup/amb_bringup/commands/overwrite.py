"""One rule for all commands that write: what a user has there is replaced only with --overwrite.

A file that a user names must not exist, nor one that a command writes beside it by the same name. A folder must be
new, empty, or one in which a command has written before, as its file `.amb` shows. The default places in `results`
belong to the commands.

A command that records removes the folders of its earlier call there, such as its bag: only those that it has made
itself, as its own file beside them shows.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from amb_bringup.commands.options import Command
from amb_bringup.commands.results import ResultError
from amb_core.ground.files.regular_files import is_folder, read_text, shown

PLACES = ("out", "results", "figures", "save_description")
"""Options that name what a command writes."""
BESIDE = {"report": (".pdf", "pdf"), "ross": (".npz", "")}
"""Commands that write another file beside the one of --out: its ending, and the option that asks for it, if any."""
REMOVED = {
    "commission.commission": (("bag", "figures"), "protocol.json", "steps"),
    "demo.demo": (("bag",), "summary.json", "bit_identical"),
    "rig.demo": (("bag",), "summary.json", "bag"),
}
"""Commands, with their module, that remove folders of their earlier call: which ones, and the JSON file that they write
beside them, with a name in it that no other command writes there."""
MARK = ".amb"
"""File in a folder in which a command has written."""

OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace files that exist, also in a folder with files of others.")
]


def with_overwrite(command: Command) -> Command:
    """Give a command that writes the option --overwrite, and check its places before it runs.

    A command without such places, or with a rule of its own, is returned as it is.
    """
    signature = inspect.signature(command)
    places = [name for name in PLACES if name in signature.parameters]
    if not places or "overwrite" in signature.parameters or command.__name__ == "recover":
        return command
    hints = get_type_hints(command, include_extras=True)
    defaults = {name: signature.parameters[name].default for name in places}

    def run(**values: Any) -> None:
        overwrite = values.pop("overwrite")
        named = [Path(values[name]) for name in places if values[name] not in (None, defaults[name])]
        if not overwrite:
            for path in [*named, *_beside(command.__name__, values, named)]:
                refuse_replacement(path)
            for path in named:
                _refuse_removal(command, path)
        before = {path: (_is_free(path), _entries(path)) for path in named}
        try:
            command(**values)
        finally:
            for path, (free, entries) in before.items():
                if free or _entries(path) != entries:  # else it has written nothing among files of others
                    _mark(path)

    own = [
        item.replace(annotation=hints[item.name], kind=inspect.Parameter.KEYWORD_ONLY)
        for item in signature.parameters.values()
    ]
    own.append(
        inspect.Parameter("overwrite", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=OverwriteOption)
    )
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
    run.__annotations__ = {item.name: item.annotation for item in own}
    return run


def refuse_replacement(path: Path) -> None:
    """Refuse a file that exists, and a folder with files that no command has written; ResultError."""
    if is_folder(path):
        if not _is_free(path):
            raise ResultError(f"folder {shown(path)}: has files of others; give a new folder, or --overwrite")
    elif path.exists() and path.suffix:  # a name without an ending is that of a folder, which cannot be made here
        raise ResultError(f"{shown(path)}: exists already; give another name, or --overwrite")


def _refuse_removal(command: Command, path: Path) -> None:
    """Refuse a folder with something to be removed that another command has made, or nobody knows who; ResultError."""
    folders, name, content = REMOVED.get(f"{command.__module__.rpartition('.')[2]}.{command.__name__}", ((), "", ""))
    for folder in folders:
        if (path / folder).exists() and not _has_written(path / name, content):
            raise ResultError(
                f"{shown(path / folder)}: was not made by this command; give another folder, or --overwrite"
            )


def _has_written(path: Path, content: str) -> bool:
    """Whether a JSON file is there, with that name in it."""
    try:
        return content in json.loads(read_text(path))
    except (OSError, ValueError, TypeError):
        return False


def _is_free(path: Path) -> bool:
    """Whether commands may write in a folder: it is not there, empty, or one in which a command has written before."""
    return not is_folder(path) or (path / MARK).exists() or not any(path.iterdir())


def _entries(path: Path) -> dict[str, int]:
    """What is in a folder, and when each was changed (ns); nothing if it cannot be read."""
    with suppress(OSError):
        return {item.name: item.lstat().st_mtime_ns for item in path.iterdir()}
    return {}


def _beside(command: str, values: Mapping[str, Any], named: list[Path]) -> list[Path]:
    """The file that a command writes beside the one of --out; none beside a folder."""
    ending, option = BESIDE.get(command, ("", ""))
    out = Path(values["out"]) if ending and values["out"] is not None else None
    if out not in named or not out.suffix or is_folder(out) or (option and not values[option]):
        return []
    return [out.with_suffix(ending)]


def _mark(path: Path) -> None:
    """Note in a folder that a command has written in it; one that cannot be written has no results either."""
    with suppress(OSError):
        if is_folder(path) and any(path.iterdir()):
            note = "Results of amb: its commands replace their files in this folder.\n"
            (path / MARK).write_text(note, encoding="utf-8")
