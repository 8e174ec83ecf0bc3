"""`amb report`: a report on any recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from amb_bringup.commands.columns import EntriesOption
from amb_bringup.commands.inputs import model_order
from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, names_file
from amb_bringup.commands.terminal import Terminal
from amb_core.data.analysis import recorded_controller
from amb_core.data.controller_choice import NO_CONTROLLER


@data_options
def report(
    files: DataOptions,
    bag: Annotated[Path, typer.Argument(help="Bag, or a data file (.csv, .mat, .npz, .parquet ...) with reference.")],
    run: Annotated[int | None, typer.Option(help="Run of the bag; by default the last one.")] = None,
    order: Annotated[str, typer.Option(help="Order of the model, or auto.")] = "10",
    entries: EntriesOption = "",
    certify: Annotated[
        bool, typer.Option(help="Also the robustness of the model with its controller, which takes some seconds.")
    ] = True,
    out: Annotated[Path, typer.Option(help="The page, an .html file; or a folder for report.html.")] = Path(
        "results/report.html"
    ),
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also a PDF beside the page, by the browser that is installed.")
    ] = False,
) -> None:
    """Regions, distortion, motion, identified model, frequency response, validation and robustness of a run."""
    from amb_core.report.pages import write_report
    from amb_core.report.pages.pdf import find_browser, write_pdf
    from amb_core.report.pages.recording import recording_report

    console = Terminal()
    browser = find_browser() if pdf else None
    if not names_file(out, (".html",)):
        out = out / "report.html"
    make_folder(out.parent)
    wanted = model_order(order)
    recording, _ = files.recording(console, bag)
    controller = files.resolve().controller
    with Stages(console) as stages:
        named = (
            recorded_controller(recording, recording.sample_rate, controller, run)
            if controller not in ("", NO_CONTROLLER)
            else None
        )
        made = recording_report(recording, run, wanted, stages.update, named, entries, certify)
    write_report(made, out)
    console.print(f"{made.title}. {made.lead}", highlight=False)
    console.print(f"report: {out}")
    if browser:
        console.print(f"PDF: {write_pdf(out, browser)}")
