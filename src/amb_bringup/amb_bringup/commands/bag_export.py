"""`amb bag export`: a recorded run as a file for other people's tools, one stamped sample per row or message."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from amb_bringup.commands.damaged_bags import warn_of_damage
from amb_bringup.commands.options import QUANTITY, Quantity
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_place, new_file
from amb_bringup.commands.terminal import Terminal
from amb_core.ground.errors import BagError
from amb_core.ground.files.regular_files import is_folder

if TYPE_CHECKING:
    from amb_core.recording.export import RunTelemetry

TABLES = {"csv": ".csv", "mat": ".mat", "parquet": ".parquet"}
LAYOUTS = {"plotjuggler": ".xml", "foxglove": ".json"}


def export(
    bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")],
    csv: Annotated[bool, typer.Option("--csv", help="A text table.")] = False,
    mat: Annotated[bool, typer.Option("--mat", help="A file for MATLAB and Octave, version 5.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="A Parquet file.")] = False,
    plotjuggler: Annotated[
        bool, typer.Option("--plotjuggler", help="A bag (.mcap) of standard ROS 2 messages, one per sample.")
    ] = False,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="An .mcap file with fields named by axis, one message per sample.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; by default BAG.csv and so on, or BAG_foxglove.mcap.", dir_okay=False),
    ] = None,
    run: Annotated[int | None, typer.Option(help="Run; by default the last one.")] = None,
    start: Annotated[
        float | None,
        typer.Option(
            "--from", help="Time of the run at which the export starts.", parser=Quantity("s"), metavar=QUANTITY
        ),
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", help="Time before which it ends.", parser=Quantity("s"), metavar=QUANTITY)
    ] = None,
    topics: Annotated[
        str,
        typer.Option(
            help="What is exported, by default all: reference, position, current; for PlotJuggler and Foxglove also "
            "region, status, spectrum."
        ),
    ] = "",
    layout: Annotated[
        bool, typer.Option("--layout", help="Also write the layout for PlotJuggler (.xml) or Foxglove (.json).")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files of these names.")] = False,
) -> None:
    """Export a recorded run as a table, or for PlotJuggler or Foxglove: one stamped sample per row or message.

    Times are those of the run, from 0. Missing samples stay missing. The bag is not changed.
    """
    chosen = {"csv": csv, "mat": mat, "parquet": parquet, "plotjuggler": plotjuggler, "foxglove": foxglove}
    from amb_core.data.analysis.recorded_clearance import recorded_clearance
    from amb_core.data.tables.clearances import clearance_fields
    from amb_core.recording import Recording
    from amb_core.recording.export import RunTelemetry, write_foxglove, write_plotjuggler, write_table
    from amb_core.recording.export.layouts import foxglove_layout, plotjuggler_layout

    tools = {
        "plotjuggler": (write_plotjuggler, plotjuggler_layout),
        "foxglove": (write_foxglove, foxglove_layout),
    }
    formats = [name for name, wanted in chosen.items() if wanted]
    if len(formats) != 1:
        raise BagError(f"give one format: {', '.join(f'--{name}' for name in chosen)}")
    form = formats[0]
    if layout and form not in LAYOUTS:
        raise BagError(f"--layout is for {' and '.join(f'--{name}' for name in LAYOUTS)}")
    ending = TABLES.get(form, ".mcap")
    path = out or bag.absolute().with_name(f"{name_of(bag)}{'' if form in TABLES else f'_{form}'}{ending}")
    make_place(path, (ending,))
    console = Terminal()
    wanted = [name.strip() for name in topics.split(",") if name.strip()]
    with ExitStack() as files:
        part = files.enter_context(new_file(path, overwrite))
        beside = files.enter_context(new_file(_layout_beside(path, form), overwrite)) if layout else None
        stages = files.enter_context(Stages(console, "steps"))
        telemetry = RunTelemetry(bag, run, start, end, stages.update)
        if form in TABLES:
            description = Recording.read_description(bag, telemetry.run, telemetry.spans[0][0], telemetry.run_ends)
            clearance = recorded_clearance(description, telemetry.axes, telemetry.run)
            write_table(telemetry, part, wanted, clearance_fields(clearance))
        else:
            tools[form][0](telemetry, part, wanted)
        if beside:
            beside.write_text(tools[form][1](telemetry.axes), encoding="utf-8")
    warn_of_damage(console, bag, telemetry.damage)
    _show(console, telemetry, path)
    if csv and clearance:
        console.print(f"not in a .csv file: {_clearances(clearance)}", highlight=False)
    if layout:
        console.print(f"layout: {_layout_beside(path, form)}", highlight=False, markup=False, soft_wrap=True)


def name_of(bag: Path) -> str:
    """Name of a bag without the ending of a file. A folder has no ending: a dot belongs to its name."""
    path = bag.absolute()
    return path.name if is_folder(path) else path.stem


def _layout_beside(path: Path, form: str) -> Path:
    return path.with_suffix(LAYOUTS[form])


def _clearances(clearance: Mapping[str, float]) -> str:
    """The clearances as the user gives them when such a file is read."""
    radial = {value for axis, value in clearance.items() if not axis.startswith("z")}
    known = ", ".join(f"{axis} {1e6 * value:g} um" for axis, value in clearance.items())
    option = f"; commands that read it take --clearance {1e6 * radial.pop():g}um" if len(radial) == 1 else ""
    return f"the clearances ({known}){option}"


def _show(console: Console, telemetry: RunTelemetry, path: Path) -> None:
    from amb_core.loop.telemetry import describe_gaps

    first, stop = telemetry.spans[0][0], telemetry.spans[-1][1]
    console.print(
        f"run {telemetry.run}, axes {', '.join(telemetry.axes)}: {telemetry.steps} samples at "
        f"{1.0 / telemetry.sample_time:g} Hz, {first * telemetry.sample_time:g} s to "
        f"{stop * telemetry.sample_time:g} s",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    if telemetry.missing:
        console.print(
            f"missing in the bag, and left out: {describe_gaps(telemetry.missing)}", style="yellow", highlight=False
        )
    console.print(f"written: {path}", highlight=False, markup=False, soft_wrap=True)
