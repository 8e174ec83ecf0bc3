"""`amb bag`: show, play, recover and export bags.

What only running a command needs is imported when it runs: its help comes at once.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands import bag_export
from amb_bringup.commands.damaged_bags import warn_of_damage
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.terminal import Terminal
from amb_core.ground.files.regular_files import is_folder

if TYPE_CHECKING:
    from amb_core.recording import RunOverview, TopicInfo

app = typer.Typer(help="Inspect, play, recover and export bags.", no_args_is_help=True)


@app.callback()
def bag() -> None:
    """Inspect, play, recover and export bags."""


@app.command()
def info(
    bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")],
    runs: Annotated[
        bool, typer.Option("--runs", help="Also runs, excitations and the last model: reads the whole bag.")
    ] = False,
) -> None:
    """Show duration and topics of a bag, even if the bag is incomplete."""
    from amb_core.recording import read_overview, read_runs

    overview = read_overview(bag)
    console = Terminal()
    written_by = f", written by {overview.written_by}" if overview.written_by else ""
    console.print(f"{bag}: {overview.messages} messages in {overview.duration:.1f} s{written_by}", style="bold")
    warn_of_damage(console, bag, overview.damage)
    console.print(_topics(overview.topics))
    if runs:
        every, model = read_runs(bag)
        if every:
            console.print(_runs(every))
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
    from amb_bringup.client.connection import GraphConnection
    from amb_ros.bag_player import BagPlayer

    with GraphConnection("", 10.0, None, ()) as connection:
        player = BagPlayer(connection.node, bag)
        with Stages(Terminal(), "messages") as stages:
            player.play(rate, lambda played: stages.update("playing", played, player.messages))


@app.command()
def recover(
    bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap file.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the new bag; by default BAG_recovered. It must not exist.")
    ] = None,
) -> None:
    """Make a whole bag of one that was not closed or is damaged: of this recorder, or of ros2 bag record.

    The bag itself is not changed. Of a whole bag no copy is made.
    """
    from amb_core.recording import inspect_bag, recover_bag

    console = Terminal()
    with Stages(console, "bytes") as stages:
        state = inspect_bag(bag, stages.update)
    console.print(f"{bag}: {state.messages} messages", style="bold", highlight=False)
    console.print(_topics(state.topics))
    for (topic, run), audit in state.runs.items():
        console.print(f"{topic}, run {run}: {audit.describe()}", highlight=False, markup=False, soft_wrap=True)
    for text in state.damage:
        console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if not state.damage:
        agrees = ", and metadata.yaml agrees" if is_folder(bag) else ""
        console.print(f"The bag is whole: every file can be read to its end{agrees}.")
        return
    with Stages(console, "bytes") as stages:
        target = out or bag.absolute().with_name(f"{bag_export.name_of(bag)}_recovered")
        made = recover_bag(state, target, stages.update)
    console.print(f"recovered bag: {made}", highlight=False, markup=False, soft_wrap=True)


app.command()(bag_export.export)


def _topics(topics: list[TopicInfo]) -> Table:
    table = Table("topic", "type", "messages")
    table.columns[2].justify = "right"
    for topic in topics:
        table.add_row(topic.name, topic.type, str(topic.messages))
    return table


def _runs(runs: list[RunOverview]) -> Table:
    table = Table("run", "telemetry", "excitations")
    for run in runs:
        steps = run.audit
        telemetry: str | Text = f"steps {steps.first} to {steps.stop - 1}, {steps.samples * run.sample_time:g} s"
        if steps.lost() or steps.doubled or steps.out_of_order:
            telemetry = Text(steps.describe(), "yellow")
        excitations = [
            f"{item.kind}: " + (f"{item.steps} steps from {item.first_step}" if item.accepted else "refused")
            for item in run.excitations
        ]
        table.add_row(str(run.run), telemetry, "\n".join(excitations) or "none")
    return table
