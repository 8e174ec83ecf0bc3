"""`amb bag info`: what a bag holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from amb_core.bags import Bag

app = typer.Typer(help="Look into bags.", no_args_is_help=True)


@app.callback()
def bag() -> None:
    """Look into bags."""


@app.command()
def info(bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")]) -> None:
    """Show topics, runs, excitations and the model of a bag, also of one that was cut off."""
    from rich.console import Console
    from rich.table import Table

    from amb_core.bags import read_bag

    content = read_bag(bag)
    console = Console()
    console.print(f"[bold]{content.path}[/bold]: {content.messages} messages in {content.duration:.1f} s")
    if content.truncated:
        console.print(f"[yellow]incomplete: {content.truncated}[/yellow]")
    topics = Table("topic", "type", "messages")
    topics.columns[2].justify = "right"
    for topic in content.topics:
        topics.add_row(topic.name, topic.type, str(topic.messages))
    console.print(topics)
    if content.runs:
        console.print(_runs(content))
    model = content.model()
    if model is not None:
        console.print(f"last model: order {model.order}, {model.method}, from {model.source}")


def _runs(bag: Bag) -> Table:
    from rich.table import Table

    from amb_core.errors import BagError

    table = Table("run", "telemetry", "excitations")
    for run in bag.runs:
        try:
            record = bag.telemetry(run)
            end = record.first_step + record.steps - 1
            telemetry = f"steps {record.first_step} to {end}, {record.steps * record.sample_time:g} s"
        except BagError as problem:
            telemetry = f"[yellow]{problem}[/yellow]"
        excitations = [
            f"{item.kind}: " + (f"{item.steps} steps from {item.first_step}" if item.accepted else "refused")
            for item in bag.excitations(run)
        ]
        table.add_row(str(run), telemetry, "\n".join(excitations) or "none")
    return table
