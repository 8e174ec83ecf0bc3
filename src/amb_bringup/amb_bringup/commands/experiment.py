"""`amb experiment`: levitate, excite, record, land, report, in one command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import model_order
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import ResultError, make_folder
from amb_bringup.commands.terminal import Terminal
from amb_bringup.graph.node_parameters import check_parameter_file
from amb_core.designs.excitation import designed_excitation
from amb_core.excitation import KINDS, excitation_from_settings
from amb_core.ground.errors import ExcitationError
from amb_core.recording import Recording
from amb_core.rig.commissioning import order_for

if TYPE_CHECKING:
    from amb_bringup.client.experiment import Experiment, ExperimentRun

DURATION = {"duration": 4.0}  # s


@declared_options({"Signal": KINDS.values()}, notes={"duration": "by default 4, or that of --design"})
def experiment(
    given: dict[str, Any],
    kind: Annotated[
        str | None, typer.Argument(help="sweep, square, multisine, prbs, white_noise or tones; or --design, or --file.")
    ] = None,
    design: Annotated[
        Path | None,
        typer.Option(help="Folder of `amb excitation design`: its excitation; other options change it, as --seed 2."),
    ] = None,
    file: Annotated[Path | None, typer.Option(help="YAML list of several experiments.", show_default=False)] = None,
    record: Annotated[Path | None, typer.Option(help="New folder for the bag.", show_default="bag in --out")] = None,
    params: ParamsOption = None,
    rig: Annotated[bool, typer.Option("--rig", help="Start the graph of a rig, if no graph runs.")] = False,
    emulator: Annotated[
        bool, typer.Option("--emulator", help="With --rig: start an emulated target on this machine.")
    ] = False,
    report: Annotated[bool, typer.Option(help="Also write the report on each run.")] = True,
    order: Annotated[
        str | None, typer.Option(help="Order of the model in the report, or auto.", show_default="by axes")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for bag and report.")] = Path("results/experiment"),
) -> None:
    """Levitate, excite, record, land and report: experiments from start to end.

    Uses the graph that runs in this DDS domain, simulator or rig, or starts one for the time. Quantities may have
    units: --amplitude 10um --frequency-end 1kHz. After Ctrl-C, and after an error, the rotor is landed and the bag
    closed.
    """
    from amb_bringup.client.experiment import has_ended
    from amb_bringup.experiments.experiment_session import GraphChoice, run_session

    experiments = _experiments(kind, design, file, given)
    bag = record or out / "bag"
    if bag.exists():
        raise ResultError(f"bag {bag}: exists already; give another folder with --record, or remove it")
    wanted = None if order is None else model_order(order)
    if params is not None:
        check_parameter_file(params)
    make_folder(out)
    make_folder(bag.parent)
    console = Terminal()
    try:
        with Stages(console, "steps") as stages:
            runs = run_session(experiments, bag, GraphChoice(params, rig, emulator), stages.update)
    except BaseException as problem:
        if has_ended(problem):
            console.print(f"landed; the recording is closed: {bag}", highlight=False)
        raise
    console.print(_table(runs))
    console.print(f"bag: {bag}", highlight=False)
    if report:
        _report(console, bag, runs, wanted, out)


def _experiments(kind: str | None, design: Path | None, file: Path | None, given: dict[str, Any]) -> list[Experiment]:
    from amb_bringup.client.experiment import Experiment
    from amb_bringup.experiments.experiment_list import read_experiments

    if [kind, design, file].count(None) != 2:
        raise ExcitationError(
            f"give one kind of excitation ({', '.join(KINDS)}), or that of a design with --design, or several "
            "experiments with --file"
        )
    if kind is not None:
        return [Experiment(kind, excitation_from_settings(kind, DURATION | given))]
    if design is not None:
        excitation = designed_excitation(design, given)
        return [Experiment(excitation.kind, excitation)]
    assert file is not None
    if given:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ExcitationError(f"{names}: not allowed with --file, whose entries have settings of their own")
    return read_experiments(file)


def _table(runs: list[ExperimentRun]) -> Table:
    table = Table("experiment", "run", "steps", "excited from", "duration", title="Experiments")
    for item in runs:
        table.add_row(item.name, str(item.run), f"{item.steps:,}", f"step {item.first_step:,}", f"{item.wall:.1f} s")
    return table


def _report(console: Console, bag: Path, runs: list[ExperimentRun], order: Any, out: Path) -> None:
    """A page for each run of the bag; a rig has one for all experiments of a levitation."""
    from amb_core.report.pages import write_report
    from amb_core.report.pages.recording import recording_report

    recording = Recording.read(bag)
    numbers = sorted({item.run for item in runs})
    with Stages(console) as stages:
        for place, number in enumerate(numbers, 1):
            axes = recording.telemetry(number).position.shape[1]
            made = recording_report(recording, number, order or order_for(axes), stages.update)
            path = out / ("report.html" if len(numbers) == 1 else f"report-{place}.html")
            write_report(made, path)
            console.print(f"{made.title}. {made.lead}", highlight=False)
            console.print(f"report: {path}", highlight=False)
