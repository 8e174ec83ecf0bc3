"""`amb compare`: several models side by side, validated on one recorded run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.columns import EntriesOption
from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import working
from amb_bringup.commands.results import make_folder, make_place, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.commands.validate import (
    FiguresOption,
    FirstStepOption,
    OutOption,
    RunOption,
    StepsOption,
    load_recorded,
)
from amb_bringup.exit_codes import NOT_VALIDATED
from amb_core.data.analysis import RecordedLoop
from amb_core.ground.errors import IdentificationError
from amb_core.identification import Comparison, StateSpaceModel, Validation
from amb_core.identification import compare as compare_models
from amb_core.identification.validation import Verdict


@data_options
def compare(
    files: DataOptions,
    models: Annotated[list[Path], typer.Argument(help="Models, as amb identify writes them.")],
    bag: Annotated[
        Path,
        typer.Argument(
            help="Bag, ideally with data that the models were not identified from, or a data file (.csv, .mat, .npz, "
            ".parquet ...)."
        ),
    ],
    run: RunOption = None,
    first_step: FirstStepOption = -1,
    steps: StepsOption = 0,
    out: OutOption = None,
    figures: FiguresOption = None,
    entries: EntriesOption = "",
    results: Annotated[Path | None, typer.Option(help="Write all numbers here as JSON.", dir_okay=False)] = None,
) -> None:
    """Compare models on the same data, the best closed loop first.

    Exit code 0 if at least one model is validated, also with reservations, 3 if none is, 1 if none can be compared.
    """
    from amb_core.report.figures import save_validation_figures
    from amb_core.report.figures.entries import entries_from

    console = Terminal()
    if out is not None:
        figures, results = figures or out, results or out / "summary.json"
    if results is not None:
        make_place(results)
    if figures is not None:
        make_folder(figures)
    loop = load_recorded(console, files, bag, run, first_step, steps)
    drawn = entries_from(entries, loop.data.input_names, loop.data.output_names)
    with working(console, "validating"):
        comparison = _judged(models, loop)
    console.print(_table(comparison.validations))
    for name, reason in comparison.refused.items():
        console.print(Text(name, "red"), f": {reason}", sep="", soft_wrap=True)
    if results is not None:
        write_json(
            results,
            {
                "models": {name: item.as_dict() for name, item in comparison.validations.items()},
                "refused": comparison.refused,
            },
        )
    if figures is not None:
        with working(console, "drawing"):
            names = save_validation_figures(figures, comparison.validations, drawn)
        console.print(f"{', '.join(names)}, .png and .html: {figures}")
    if all(item.verdict is Verdict.NOT_VALIDATED for item in comparison.validations.values()):
        raise typer.Exit(NOT_VALIDATED)


def _judged(models: list[Path], loop: RecordedLoop) -> Comparison:
    """Validations by name, the best first, and the reason for each model without one."""
    loaded, refused = {}, {}
    for name, path in zip(_names(models), models, strict=True):
        try:
            loaded[name] = StateSpaceModel.load(path)
        except IdentificationError as problem:  # the others can still be validated
            refused[name] = str(problem)
    comparison = compare_models(loaded, loop)
    return replace(comparison, refused={**refused, **comparison.refused})


def _names(models: list[Path]) -> list[str]:
    """The name of each file, with as many of its folders as needed to distinguish them."""
    for depth in range(1, max(len(path.parts) for path in models) + 1):
        names = [str(Path(*path.parts[-depth:]).with_suffix("")) for path in models]
        if len(set(names)) == len(names):
            return names
    return [f"{number}: {path}" for number, path in enumerate(models, start=1)]


def _table(validations: Mapping[str, Validation]) -> Table:

    items = list(validations.values())
    one = items[0]
    data = f"{one.data.samples} samples, {', '.join(dict.fromkeys(item.source for item in one.data.experiments))}"
    table = Table("model", *validations, title=f"Models on {data}", title_justify="left")
    table.add_row("method", *(item.model.method for item in items))
    table.add_row("order", *(str(item.model.order) for item in items))
    for index, name in enumerate(one.model.output_names):
        if one.closed_loop is not None:
            table.add_row(f"closed-loop fit {name}", *(f"{item.fit[index]:.2f} %" for item in items))
        table.add_row(f"one-step fit {name}", *(f"{item.one_step_fit[index]:.3f} %" for item in items))
    stability: dict[bool | None, str | Text] = {True: "stable", False: Text("unstable", "red"), None: "not checked"}
    table.add_row("closed loop", *(stability[item.closed_loop_stable] for item in items))
    table.add_row("unstable poles", *(str(len(item.model.unstable_poles())) for item in items))
    table.add_row("residuals white", *("yes" if item.white else "no" for item in items))
    table.add_row("independent of inputs", *("yes" if item.independent else "no" for item in items))
    colours = {Verdict.VALIDATED: "", Verdict.RESERVATIONS: "yellow", Verdict.NOT_VALIDATED: "red"}
    table.add_row("verdict", *(Text(item.verdict, colours[item.verdict]) for item in items))
    table.add_row("because not", *("\n".join(condition.name for condition in item.failed) for item in items))
    return table
