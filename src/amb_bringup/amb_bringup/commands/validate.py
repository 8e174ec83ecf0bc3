"""`amb validate`: validates a model on a recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from amb_bringup.commands.columns import EntriesOption
from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import working
from amb_bringup.commands.results import make_folder, make_place, write_json
from amb_bringup.commands.terminal import Terminal, say
from amb_bringup.exit_codes import NOT_VALIDATED
from amb_core.data.analysis import RecordedLoop
from amb_core.data.controller_choice import NO_CONTROLLER, needs_controller
from amb_core.identification import StateSpaceModel
from amb_core.identification.validation import validate as judge

RunOption = Annotated[int | None, typer.Option(help="Run of the bag; by default the last one.")]
FirstStepOption = Annotated[
    int, typer.Option(help="First step used; -1 for where the last excitation starts, or all without one.")
]
StepsOption = Annotated[int, typer.Option(help="Number of steps used; 0 for all to the end of the excitation.")]
OutOption = Annotated[Path | None, typer.Option(help="Folder for summary.json and figures.")]
FiguresOption = Annotated[
    Path | None,
    typer.Option(help="Folder for response, prediction, bode and residuals (PNG and HTML).", file_okay=False),
]


@data_options
def validate(
    files: DataOptions,
    model: Annotated[Path, typer.Argument(help="Model, as amb identify writes it (.json, .npz or .mat).")],
    bag: Annotated[
        Path,
        typer.Argument(
            help="Bag, ideally with data that the model was not identified from, or a data file (.csv, .mat, .npz, "
            ".parquet ...)."
        ),
    ],
    horizon: Annotated[list[int] | None, typer.Option(help="Prediction horizon in steps; may be repeated.")] = None,
    run: RunOption = None,
    first_step: FirstStepOption = -1,
    steps: StepsOption = 0,
    out: OutOption = None,
    figures: FiguresOption = None,
    entries: EntriesOption = "",
    results: Annotated[Path | None, typer.Option(help="Write all numbers here as JSON.", dir_okay=False)] = None,
) -> None:
    """Validate a model: closed loop, distortion, predictions, residuals and frequency response, on one page.

    Exit code 0 if the model is validated, also with reservations, 3 if it is not, 1 if it could not be validated.
    """
    from amb_core.report.figures import save_validation_figures
    from amb_core.report.figures.entries import entries_from

    console = Terminal(stderr=True)  # only the report goes to the standard output
    if out is not None:
        figures, results = figures or out, results or out / "summary.json"
    if results is not None:
        make_place(results)
    if figures is not None:
        make_folder(figures)
    known = StateSpaceModel.load(model)
    loop = load_recorded(console, files, bag, run, first_step, steps)
    drawn = entries_from(entries, loop.data.input_names, loop.data.output_names)
    with working(console, f"validating order {known.order} on {loop.data.samples} samples"):
        validation = judge(known, loop.data, loop.controller, plant=loop.plant, horizons=horizon or None)
    say(validation.report())
    if results is not None:
        write_json(results, validation.as_dict())
    if figures is not None:
        with working(console, "drawing"):
            names = save_validation_figures(figures, {model.stem: validation}, drawn)
        console.print(f"{', '.join(names)}, .png and .html: {figures}")
    if not validation.validated:
        raise typer.Exit(NOT_VALIDATED)


def load_recorded(
    console: Console, files: DataOptions, bag: Path, run: int | None, first_step: int, steps: int
) -> RecordedLoop:
    """Data and parameters of a bag, or the data of a file, for which no run and steps can be chosen.

    If no controller is known and the data need one, this and the consequence are reported.
    """
    loop = files.read(console, bag, run=run, first_step=first_step, steps=steps)
    if loop.controller is None and needs_controller(loop.data) and files.resolve().controller != NO_CONTROLLER:
        console.print(
            f"{bag} has no controller parameters; the closed loop of the models is not validated. Give the "
            "controller with --controller",
            style="yellow",
        )
    return loop
