"""`amb bag info`, `amb bag play`: show the content of a bag, and publish it again on the topics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import rclpy
import typer
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.progress import Stages
from amb_core.errors import BagError
from amb_core.recording import Recording
from amb_ros.bag_player import BagPlayer

app = typer.Typer(help="Inspect and play bags.", no_args_is_help=True)


@app.callback()
def bag() -> None:
    """Inspect and play bags."""


@app.command()
def info(bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")]) -> None:
    """Show topics, runs, excitations and the model of a bag, even if the bag is incomplete."""
    recording = Recording.read(bag)
    console = Console()
    console.print(f"[bold]{recording.path}[/bold]: {recording.messages} messages in {recording.duration:.1f} s")
    if recording.truncated:
        console.print(f"[yellow]incomplete: {recording.truncated}[/yellow]")
    topics = Table("topic", "type", "messages")
    topics.columns[2].justify = "right"
    for topic in recording.topics:
        topics.add_row(topic.name, topic.type, str(topic.messages))
    console.print(topics)
    if recording.runs:
        console.print(_runs(recording))
    model = recording.model()
    if model is not None:
        console.print(f"last model: order {model.order}, {model.method}, from {model.source}")


@app.command()
def play(
    bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")],
    rate: Annotated[float, typer.Option(help="How many times faster than recorded.")] = 1.0,
) -> None:
    """Publish telemetry, excitations and states of a bag again, for region_monitor, identifier and your own nodes.

    Do not play a bag into a graph with a simulator: both would publish on the same topics.
    """
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Python handles Ctrl-C, not the context
    try:
        node = Node("bag_player", start_parameter_services=False)
        player = BagPlayer(node, bag)
        with Stages(Console(), "messages") as stages:
            player.play(rate, lambda played: stages.update("playing", played, player.messages))
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _runs(bag: Recording) -> Table:

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
