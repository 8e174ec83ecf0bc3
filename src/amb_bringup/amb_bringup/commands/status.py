"""`amb status`: what is in a folder of work on a bearing, what is stale, and which command comes next."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.progress import working
from amb_bringup.commands.terminal import Terminal, say

if TYPE_CHECKING:
    from amb_core.report.project import ProjectStatus

COLOURS = {"current": "green", "stale": "yellow", "unknown": "yellow"}


def status(
    folder: Annotated[Path, typer.Argument(help="The project's folder.")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Show what is in a folder of work on a bearing, what is stale, and the command that comes next.

    Bearings, maps, designs, experiments, models and certificates are found by their content. A map or experiment is
    stale if the bearing's file states another value of a parameter now; everything else if what it was made from is
    stale or has changed. Nothing is written. Example: amb status ~/my_bearing
    """
    from amb_core.ground.results import VERSION
    from amb_core.report.project import status_of

    console = Terminal(stderr=True)
    with working(console, "reading"):
        project = status_of(folder)
    if as_json:
        say(json.dumps({"version": VERSION, **project.as_dict()}, indent=2))
        return
    shown = Terminal()
    if project.items:
        shown.print(_table(project))
    shown.print(f"next: {project.step.reason}", highlight=False, soft_wrap=True)
    if project.step.command:
        if folder.resolve() != Path.cwd():
            shown.print(f"  cd {shlex.quote(str(folder))}", highlight=False, soft_wrap=True)
        shown.print(f"  {project.step.command}", highlight=False, soft_wrap=True)


def _table(project: ProjectStatus) -> Table:
    table = Table("what", "where", "state", "")
    for item in project.items:
        table.add_row(item.kind, str(item.path), Text(item.state, COLOURS[item.state]), item.reason)
    return table
