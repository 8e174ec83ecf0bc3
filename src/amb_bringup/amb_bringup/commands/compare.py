"""`amb compare`: several models side by side, judged by one recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from amb_bringup.commands.validate import FiguresOption, FirstStepOption, RunOption, StepsOption, load_recorded

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table

    from amb_core.identification import Validation


def compare(
    models: Annotated[list[Path], typer.Argument(help="Models, as amb identify writes them.")],
    bag: Annotated[Path, typer.Argument(help="Bag of other data than the models', or a .csv, .npz or .mat file.")],
    run: RunOption = None,
    first_step: FirstStepOption = -1,
    steps: StepsOption = 0,
    figures: FiguresOption = None,
    results: Annotated[Path | None, typer.Option(help="Write all numbers here as JSON.", dir_okay=False)] = None,
) -> None:
    """Put models side by side, judged by the same data, the best closed loop first."""
    from rich.console import Console

    from amb_bringup.commands.results import make_folder, write_json

    console = Console()
    if figures is not None:
        make_folder(figures)
    loop = load_recorded(console, bag, run, first_step, steps)
    found, refused = {}, {}
    from amb_core.errors import IdentificationError
    from amb_core.identification import StateSpaceModel, validate

    with console.status("validating"):
        for name, path in zip(_names(models), models, strict=True):
            try:
                found[name] = validate(StateSpaceModel.load(path), loop.data, loop.controller, plant=loop.plant)
            except IdentificationError as problem:  # the others can still be judged
                refused[name] = str(problem)
    found = dict(sorted(found.items(), key=lambda item: _quality(item[1]), reverse=True))
    if found:
        console.print(_table(found))
    for name, reason in refused.items():
        console.print(f"[red]{name}[/red]: {reason}", soft_wrap=True)
    if not found:
        raise IdentificationError("none of the models could be judged")
    if results is not None:
        write_json(results, {"models": {name: item.as_dict() for name, item in found.items()}, "refused": refused})
    if figures is not None:
        from amb_core.figures import save_validation_figures

        with console.status("drawing"):
            names = save_validation_figures(figures, found)
        console.print(f"{', '.join(names)}, .png and .html: {figures}")


def _names(models: list[Path]) -> list[str]:
    """The name of each file, with as many of its folders as tell them apart."""
    for depth in range(1, max(len(path.parts) for path in models) + 1):
        names = [str(Path(*path.parts[-depth:]).with_suffix("")) for path in models]
        if len(set(names)) == len(names):
            return names
    return [f"{number}: {path}" for number, path in enumerate(models, start=1)]


def _quality(validation: Validation) -> tuple[bool, float, float]:
    fit = validation.fit if len(validation.fit) else validation.one_step_fit
    return validation.validated, float(fit.min()), float(validation.one_step_fit.min())


def _table(found: Mapping[str, Validation]) -> Table:
    from rich.table import Table

    one = next(iter(found.values()))
    outputs = one.model.output_names
    data = f"{one.data.samples} samples, {', '.join(dict.fromkeys(item.source for item in one.data.experiments))}"
    table = Table("model", "method", "order", title=f"Models judged by {data}")
    for heading in (
        *(f"closed-loop fit {name} (%)" for name in outputs),
        *(f"one-step fit {name} (%)" for name in outputs),
    ):
        table.add_column(heading, justify="right")
    for heading in ("closed loop", "unstable poles", "white", "independent", "validated"):
        table.add_column(heading)
    for name, item in found.items():
        table.add_row(
            name,
            item.model.method,
            str(item.model.order),
            *(f"{fit:.2f}" for fit in (item.fit if len(item.fit) else [float("nan")] * len(outputs))),
            *(f"{fit:.3f}" for fit in item.one_step_fit),
            {True: "stable", False: "[red]unstable[/red]", None: "-"}[item.closed_loop_stable],
            str(len(item.model.unstable_poles())),
            "yes" if item.white else "no",
            "yes" if item.independent else "no",
            "[green]yes[/green]" if item.validated else "[red]no[/red]",
        )
    return table
