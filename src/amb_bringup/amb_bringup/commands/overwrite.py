"""One rule for all commands that write: what a user has there is replaced only with --overwrite.

A file that a user names must not exist, nor one that a command writes beside it by the same name. A folder must be
new, empty, or one in which a command has written before, as its file `.amb` shows. The default places in `results`
belong to the commands.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from amb_bringup.commands.options import Command
from amb_bringup.commands.results import ResultError
from amb_core.ground.files.regular_files import is_folder, shown

PLACES = ("out", "results", "figures", "save_description")
"""Options that name what a command writes."""
BESIDE = {"report": (".pdf", "pdf"), "ross": (".npz", "")}
"""Commands that write another file beside the one of --out: its ending, and the option that asks for it, if any."""
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
        try:
            command(**values)
        finally:
            for path in named:
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
        if not (path / MARK).exists() and any(path.iterdir()):
            raise ResultError(f"folder {shown(path)}: has files of others; give a new folder, or --overwrite")
    elif path.exists() and path.suffix:  # a name without an ending is that of a folder, which cannot be made here
        raise ResultError(f"{shown(path)}: exists already; give another name, or --overwrite")


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
