"""The reference of the command line in Markdown, from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from typer import Context
from typer.cli import get_docs_for_click
from typer.main import get_command

from amb_bringup.cli import LateCommand, app


def commands() -> Iterator[tuple[str, Any]]:
    """Every command that can be called, with its full name."""

    def walk(name: str, command: Any) -> Iterator[tuple[str, Any]]:
        command = command.load() if isinstance(command, LateCommand) else command
        parts = getattr(command, "commands", None)
        if parts is None:
            yield name, command
        for part, inner in (parts or {}).items():
            yield from walk(f"{name} {part}", inner)

    yield from walk("amb", get_command(app))


def command_reference() -> str:
    """A section for each command: what it does, usage, arguments and options."""
    sections = [
        get_docs_for_click(obj=command, ctx=Context(command), name=name, title=name, indent=1)
        for name, command in commands()
    ]
    text = "\n".join(sections).replace("**Usage**:\n\n", "").replace("```console\n$ ", "```text\n")
    return _as_definitions(text)


def _as_definitions(text: str) -> str:
    """Lists of options as definition lists, which wrap well on narrow pages."""
    lines = []
    for line in text.splitlines():
        option = re.fullmatch(r"\* (`.*?`)(?:: (.*))?", line)
        if option is None:
            lines.append(_escaped(line))
        else:
            lines += [option[1], f": {_escaped(option[2] or 'see above')}", ""]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)) + "\n"


def _escaped(text: str) -> str:
    """Text that is not taken for HTML; what stands between backticks is left as it is."""
    parts = text.split("`")
    parts[::2] = [
        part.replace("<", "&lt;").replace("*", r"\*") if not part.startswith("**") else part for part in parts[::2]
    ]
    return "`".join(parts)
