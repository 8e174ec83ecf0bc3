"""`amb map`: the frequency-amplitude graph of a bearing from a parameter file, without a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import load_loop, load_regions, typed_value
from amb_bringup.commands.interrupt import Interrupt
from amb_bringup.commands.map_confirmation import confirmation_summary, print_confirmation
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.exit_codes import INTERRUPTED
from amb_core.ground.errors import AmbError, ParameterError, RegionError
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import (
    BOUNDARIES,
    Comparison,
    ConfirmationSettings,
    GridCell,
    MapProgress,
    MapSettings,
    RegionMap,
    analytic_lines,
    build_grid,
    build_map,
    compare,
    confirm_map,
    sweep_rate_text,
)


@declared_options({"Sweeps": [MapSettings], "Confirmation, with --confirm": [ConfirmationSettings]})
def region_map(
    given: dict[str, Any],
    params: ParamsOption = None,
    confirm: Annotated[
        bool,
        typer.Option(
            "--confirm",
            help="Bisect the boundaries with fixed sines, and repeat the sweeps at another rate.",
        ),
    ] = False,
    grid: Annotated[
        list[str] | None,
        typer.Option(
            help="Design parameter and values, as amplifier.bias_current=2,3,4 or controller.derivative_gain=30,38; "
            "if repeated, all combinations. Makes a grid of maps.",
            metavar="NAME=V1,V2,...",
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running dask scheduler, tls://host:port, to run the sweeps.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine to run the sweeps; one per core if not given.")
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(help="Folder of finished sweeps, instead of ~/.cache/amb/region_map.", file_okay=False),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for map.json, summary.json and figures.")] = Path("results/map"),
) -> None:
    """Find where regions B, C and D begin, amplitude by amplitude, from simulated sweeps.

    Every finished sweep and dwell is kept. The same command resumes after an interruption.
    """
    settings, confirmation = _settings(given, confirm)
    design = _design(grid or [])
    if design and confirm:
        raise RegionError("--confirm is not available with --grid; confirm a map of one design")
    plant, controller = load_loop(params)
    regions = load_regions(params)
    make_folder(out)
    console = Terminal()
    with Interrupt() as interrupt, Stages(console) as stages:

        def show(progress: MapProgress) -> None:
            boundaries = "" if progress.map is None else _ranges(progress.map)
            stages.update(stage, progress.done, progress.total, boundaries)

        stage = "sweeps"
        stages.update(stage)
        options: dict[str, Any] = {
            "cache": cache, "scheduler": scheduler, "workers": workers,
            "progress": show, "cancelled": interrupt.asked,
        }  # fmt: skip
        try:
            if design:
                cells = build_grid(settings, plant, controller, design, regions, **options)
            else:
                built = build_map(settings, plant, controller, regions, **options)
                if confirm and not interrupt.asked():
                    stage = "confirmation"
                    built = confirm_map(built, plant, controller, regions, confirmation, **options)
        except AmbError:
            if interrupt.asked():  # before any sweep was finished
                raise KeyboardInterrupt from None
            raise
    if design:
        _write_grid(out, cells, console)
    else:
        _write_map(out, built, plant, controller, console)
    if interrupt.asked():
        typer.echo("amb: interrupted; finished sweeps are kept: run the same command to resume", err=True)
        raise typer.Exit(INTERRUPTED)


def _settings(given: dict[str, Any], confirm: bool) -> tuple[MapSettings, ConfirmationSettings]:
    """Settings of the sweeps and of the confirmation from the options."""
    asked = {name: value for name, value in given.items() if name in ConfirmationSettings.model_fields}
    if asked and not confirm:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in asked)
        raise RegionError(f"{names}: allowed with --confirm only")
    sweeps = {name: value for name, value in given.items() if name not in asked}
    return validate(MapSettings, sweeps, RegionError), validate(ConfirmationSettings, asked, RegionError)


def _ranges(region_map: RegionMap) -> str:
    """The frequencies at which each region begins, as text."""
    return ", ".join(
        f"{region.name} {_range(region_map, region)}" for region in BOUNDARIES if _range(region_map, region)
    )


def _range(region_map: RegionMap, region: Region) -> str:

    frequency = region_map.frequencies(region)
    return "" if np.isnan(frequency).all() else f"{np.nanmin(frequency):.0f} to {np.nanmax(frequency):.0f}"


def _design(grid: list[str]) -> dict[str, list[Any]]:
    """Design parameters and their values from the command line."""
    design: dict[str, list[Any]] = {}
    for text in grid:
        name, sign, values = text.partition("=")
        if not (name and sign and values):
            raise ParameterError(f"--grid {text}: must be a name and its values, as amplifier.bias_current=2,3,4")
        if name in design:
            raise ParameterError(f"--grid {name} is given twice; give all its values at once")
        design[name] = [typed_value(word) for word in values.split(",")]
    return design


def _write_map(
    out: Path, region_map: RegionMap, plant: PlantParameters, controller: ControllerParameters, console: Console
) -> None:
    """Write map, summary and figures, and print the tables."""
    from amb_core.report.figures import map_chart

    region_map.save(out / "map.json")
    lines = analytic_lines(plant, controller, region_map.settings.axes)
    comparisons = compare(region_map, lines)
    write_json(out / "summary.json", _summary(region_map, comparisons))
    map_chart(region_map, lines).save(out, "map")
    console.print(_boundary_table(region_map))
    console.print(_line_table(comparisons))
    console.print(f"rate of the sweeps: {sweep_rate_text(region_map)}")
    print_confirmation(region_map, console)
    if not region_map.complete:
        console.print("not resolved as requested; more sweeps (--max-sweeps) would help", style="yellow")
    console.print(f"map.json, summary.json, map.png, map.html: {out}")


def _write_grid(out: Path, cells: list[GridCell], console: Console) -> None:
    """A folder for each map of a grid, and summary and figure of all."""
    from amb_core.report.figures import map_grid_chart

    summaries, problems = [], []
    table = Table(*cells[0].values, "sweeps", "B (Hz)", "C (Hz)", "D (Hz)", title="Grid of region maps")
    for cell in cells:
        name = ",".join(f"{key}={value}" for key, value in cell.values.items())
        summary: dict[str, Any] = {"values": cell.values}
        if cell.map is None or cell.plant is None or cell.controller is None:
            summary["problem"] = cell.problem
            row = ["none"]
            problems.append(f"{name}: {cell.problem}")
        else:
            folder = out / name.replace("/", "_")  # a value may be the path of a file
            make_folder(folder)
            cell.map.save(folder / "map.json")
            summary |= {"map": f"{folder.name}/map.json"}
            summary |= _summary(
                cell.map, compare(cell.map, analytic_lines(cell.plant, cell.controller, cell.map.settings.axes))
            )
            row = [str(len(cell.map.sweeps)), *(_range(cell.map, region) for region in BOUNDARIES)]
        summaries.append(summary)
        table.add_row(*(str(value) for value in cell.values.values()), *row)
    write_json(out / "summary.json", {"maps": summaries})
    files = "summary.json, a folder with map.json for each"
    if any(cell.map is not None for cell in cells):
        map_grid_chart(cells).save(out, "grid")
        files += ", grid.png, grid.html"
    console.print(table)
    for problem in problems:
        console.print(f"{problem}", style="yellow")
    console.print(f"{files}: {out}")


def _summary(region_map: RegionMap, comparisons: list[Comparison]) -> dict[str, Any]:
    confirmed = {} if region_map.confirmation is None else {"confirmation": confirmation_summary(region_map)}
    return {
        "complete": region_map.complete,
        "sweep_rate": sweep_rate_text(region_map),
        "sweeps": [
            {
                "amplitude": sweep.amplitude,
                "boundaries": {region.name: edge.frequency for region, edge in sweep.boundaries.items()},
                "resonance": [region.name for region, edge in sweep.boundaries.items() if edge.resonance],
            }
            for sweep in region_map.sweeps
        ],
        "lines_over_boundaries": [
            {
                "line": one.line,
                "region": one.region.name,
                "amplitudes": len(one.ratio),
                "median_ratio": one.median,
                "smallest_ratio": one.ratio.min(),
                "largest_ratio": one.ratio.max(),
            }
            for one in comparisons
        ],
    } | confirmed


def _boundary_table(region_map: RegionMap) -> Table:

    table = Table(title="Where the regions begin; * by ordinary resonance")
    table.add_column("amplitude (um)", justify="right")
    for region in BOUNDARIES:
        table.add_column(f"{region.name} (Hz)", justify="right")
    for sweep in region_map.sweeps:
        edges = [sweep.boundaries.get(region) for region in BOUNDARIES]
        texts = ["" if edge is None else f"{edge.frequency:.1f}{'*' if edge.resonance else ' '}" for edge in edges]
        table.add_row(f"{1e6 * sweep.amplitude:.2f}", *texts)
    return table


def _line_table(comparisons: list[Comparison]) -> Table:

    table = Table("line", "region", "amplitudes", "median", "range", title="Frequency of analytic lines over simulated")
    for one in comparisons:
        spread = f"{one.ratio.min():.2f} to {one.ratio.max():.2f}"
        table.add_row(one.line, one.region.name, str(len(one.ratio)), f"{one.median:.2f}", spread)
    return table
