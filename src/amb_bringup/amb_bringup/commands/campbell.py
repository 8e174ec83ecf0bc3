"""`amb campbell`: experiments over running speeds without a running graph, and the modes of the identified models."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from amb_bringup.commands.inputs import load_loop
from amb_bringup.commands.interrupt import Interrupt
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import ResultError, make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.exit_codes import INTERRUPTED
from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.rig.running_speeds import IdentifiedCampbell, SpeedSettings, identify_over_speeds

RPM = 60.0
COLUMNS = (
    "rpm", "kind", "computed_natural_hz", "identified_natural_hz", "frequency_error_percent",
    "computed_damping_ratio", "identified_damping_ratio", "computed_whirl", "identified_whirl", "assurance",
)  # fmt: skip


@declared_options({"Experiments": [SpeedSettings]})
def campbell(
    given: dict[str, Any],
    params: ParamsOption = None,
    max_speed: Annotated[float, typer.Option(help="Highest running speed, in rpm.", min=1.0, max=300_000.0)] = 6_000.0,
    speeds: Annotated[int, typer.Option(help="Number of running speeds, from 0 to the highest.", min=2, max=1000)] = 4,
    at: Annotated[
        str | None, typer.Option(help="Running speeds in rpm, ascending, instead: as 0,1500,3000.", metavar="V1,V2,...")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running dask scheduler, tls://host:port, to run the experiments.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine to run them; one per core if not given.", min=1)
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder of finished models, instead of ~/.cache/amb/running_speeds.", file_okay=False),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for campbell.png and .html, modes.csv, summary.json and the models.")
    ] = Path("results/campbell"),
) -> None:
    """Identify models at several running speeds, and draw their modes over the computed Campbell diagram.

    Each experiment is simulated: an orthogonal multisine on all axes of the machine, in the loop without ROS. Finished
    models are kept. The same command resumes after an interruption.
    """
    plant, controller = load_loop(params)
    settings = validate(SpeedSettings, given)
    wanted = np.linspace(0.0, max_speed, speeds) if at is None else np.array(_speeds(at))
    make_folder(out)
    console = Terminal()
    with Interrupt() as interrupt, Stages(console, "speeds") as stages:
        diagram = identify_over_speeds(
            plant,
            controller,
            wanted / RPM,
            settings,
            cache=cache,
            scheduler=scheduler,
            workers=workers,
            progress=stages.update,
            cancelled=interrupt.asked,
        )
    if diagram is None:
        typer.echo("amb: interrupted; finished models are kept: run the same command to resume", err=True)
        raise typer.Exit(INTERRUPTED)
    _write(out, diagram)
    console.print(_table(diagram))
    for result in diagram.results:
        if result.problem:
            console.print(f"{result.rpm:.0f} rpm: no model: {result.problem}", style="yellow", soft_wrap=True)
    for remark in diagram.computed.remarks:
        console.print(remark, style="yellow", soft_wrap=True)
    if not diagram.computed.stable:
        console.print("the computed loop is unstable at some of the speeds", style="yellow")
    console.print(f"campbell.png, campbell.html, modes.csv, summary.json, models: {out}", soft_wrap=True)


def _speeds(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise ParameterError(f"--at {text}: must be running speeds in rpm, as 0,1500,3000") from None


def _write(out: Path, diagram: IdentifiedCampbell) -> None:
    """Figure, table, summary, and a model for each speed."""
    from amb_core.report.figures.campbell import campbell_chart

    campbell_chart(diagram.computed, diagram.identified, "Campbell diagram, identified over computed").save(
        out, "campbell"
    )
    write_json(out / "summary.json", diagram.to_json())
    try:
        with (out / "modes.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(diagram.rows())
    except OSError as problem:
        raise ResultError(f"{out / 'modes.csv'}: cannot be written: {problem.strerror}") from None
    for result in diagram.results:
        if result.model is not None:
            result.model.save(out / f"model_{result.rpm:g}_rpm.json")


def _table(diagram: IdentifiedCampbell) -> Table:
    table = Table("rpm", "mode", "whirl", "computed (Hz)", "identified (Hz)", "error (%)", "damping ratio")
    table.title = "Modes of the closed loop, computed and identified"
    for row in diagram.rows():
        table.add_row(
            f"{row['rpm']:.0f}",
            row["kind"] or "-",
            _both(row, "whirl", ""),
            _number(row.get("computed_natural_hz"), ".5g"),
            _number(row.get("identified_natural_hz"), ".5g"),
            _number(row.get("frequency_error_percent"), "+.2f"),
            _both(row, "damping_ratio", ".4f"),
        )
    return table


def _both(row: dict[str, Any], name: str, form: str) -> str:
    """Computed and identified value of a mode; one of them where both look alike."""
    values = [_number(row.get(f"{side}_{name}"), form) for side in ("computed", "identified")]
    return values[0] if values[0] == values[1] else ", ".join(values)


def _number(value: float | str | None, form: str) -> str:
    return "-" if value is None else format(value, form)
