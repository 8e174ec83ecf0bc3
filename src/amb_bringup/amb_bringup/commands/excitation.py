"""`amb excitation check` and `design`: the regions in which an excitation would run, and the largest one in A."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import load_loop, load_regions
from amb_bringup.commands.options import declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, write_json
from amb_core.errors import RegionError
from amb_core.excitation import KINDS, excitation_from_request, generate
from amb_core.excitation_design import (
    DesignedExcitation,
    ExcitationCheck,
    Trial,
    TrialBench,
    check_excitation,
    design_excitation,
)
from amb_core.excitation_design.notes import made_with
from amb_core.excitation_design.summary import check_summary, design_summary, trial_summary
from amb_core.figures import overlay_chart
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import RegionMap
from amb_core.units import UM

Loop = tuple[ControllerParameters, PlantParameters, RegionParameters | None]


app = typer.Typer(help="Check or design an excitation on a region map.", no_args_is_help=True)

DESIGNED = ("square", "multisine", "prbs")
DURATION = {"duration": 4.0}  # s
NOTES = {"phasing": "by default optimised", "interleaved": "by default true with axes both"}

MapFile = Annotated[Path, typer.Option("--map", help="Region map, as `amb map` writes it.")]
LoopParams = Annotated[
    Path | None,
    typer.Option(help="Parameter file of all nodes, instead of the loop the map was made with."),
]
Out = Annotated[Path, typer.Option(help="Folder for summary.json and figures.")]


@app.callback()
def excitation() -> None:
    """Excitations on a region map."""


@app.command()
@declared_options({"Signal": KINDS.values()}, defaults=DURATION)
def check(
    kind: Annotated[str, typer.Argument(help="sweep, square, multisine, prbs, white_noise or tones.")],
    given: dict[str, Any],
    simulate: Annotated[bool, typer.Option(help="Also simulate the full plant, and classify its response.")] = False,
    map_file: MapFile = Path("results/map/map.json"),
    params: LoopParams = None,
    out: Out = Path("results/excitation/check"),
) -> None:
    """Compare an excitation with a region map: the shares of its power in A, B, C and D, and what to do."""
    region_map, loop = _load(map_file, params)
    signal = generate(excitation_from_request(kind, given), loop[0].sample_rate)
    found = check_excitation(signal, region_map, *loop[:2])
    console = Console()
    make_folder(out)
    summary: dict[str, Any] = {"map": str(map_file), "parameters": signal.parameters.model_dump()}
    summary["check"] = check_summary(found)
    _print_check(console, found)
    if simulate:
        with Stages(console, "steps") as stages:
            bench = TrialBench(loop[1], loop[0], loop[2])
            trial = bench.run(signal, lambda done, total: stages.update("simulated", done, total))
        summary["trial"] = trial_summary(trial)
        console.print(_trial_line(trial))
    _write(out, summary, found, region_map, console)


@app.command()
@declared_options(
    {"Signal": [KINDS[kind] for kind in DESIGNED]}, leave_out=["amplitude"], defaults=DURATION, notes=NOTES
)
def design(
    kind: Annotated[str, typer.Argument(help="square, multisine or prbs.")],
    given: dict[str, Any],
    model_order: Annotated[int, typer.Option(help="States of the model that is to be identified (-).")] = 10,
    margin: Annotated[float, typer.Option(help="Amplitude over the largest in region A (-).")] = 0.9,
    tolerance: Annotated[float, typer.Option(help="Relative error of that largest amplitude (-).")] = 0.02,
    map_file: MapFile = Path("results/map/map.json"),
    params: LoopParams = None,
    out: Out = Path("results/excitation/design"),
) -> None:
    """Find the largest amplitude that stays in region A, from the map and confirmed by simulation of the full plant."""
    region_map, loop = _load(map_file, params)
    console = Console()
    make_folder(out)
    with Stages(console, "steps") as stages:
        designed = design_excitation(
            kind,
            given,
            region_map,
            *loop,
            model_order=model_order,
            margin=margin,
            tolerance=tolerance,
            progress=lambda amplitude, done, total: stages.update(f"{UM * amplitude:8.3f} um", done, total),
        )
    _print_check(console, designed.check)
    console.print(_trial_line(designed.trial))
    console.print(_design_table(designed))
    _write(out, {"map": str(map_file), **design_summary(designed)}, designed.check, region_map, console)


def _load(map_file: Path, params: Path | None) -> tuple[RegionMap, Loop]:
    """The map, and the loop: that of a parameter file, or the one the map was made with."""
    if not _exists(map_file):
        raise RegionError(f"region map {map_file}: there is no such file; `amb map` makes one (results/map/map.json)")
    region_map = RegionMap.load(map_file)
    if params is None:
        regions = made_with(region_map, "regions", RegionParameters) if "regions" in region_map.provenance else None
        controller = made_with(region_map, "controller", ControllerParameters)
        return region_map, (controller, made_with(region_map, "plant", PlantParameters), regions)
    plant, controller = load_loop(params)
    return region_map, (controller, plant, load_regions(params))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # the reader of the file reports what is wrong with the path
        return True


def _print_check(console: Console, found: ExcitationCheck) -> None:
    colour = {"A": "green" if found.certain else "yellow", "B": "yellow"}.get(found.predicted.name, "red")
    console.print(_check_table(found))
    console.print(f"[{colour}]{found.verdict}[/{colour}]")
    for note in found.notes:
        console.print(f"[yellow]note: {note}[/yellow]")


def _check_table(found: ExcitationCheck) -> Table:

    axes = found.axes
    table = Table("quantity", *(axis.axis for axis in axes), "limit", title=f"{found.kind} on the region map")
    for region in Region:
        table.add_row(f"share of the power in {region.name}", *(f"{100 * axis.shares[region]:.1f} %" for axis in axes))
    for region in (Region.B, Region.C, Region.D):
        table.add_row(f"load towards {region.name}", *(f"{axis.load.towards[region]:.2f}" for axis in axes), "1")
    table.add_row("load, unknown parts counted fully", *(f"{axis.load.linear:.2f}" for axis in axes), "1")
    table.add_row("rms, peak (um)", *(f"{UM * axis.rms:.2f}, {UM * axis.peak:.2f}" for axis in axes))
    table.add_row("crest factor", *(f"{axis.crest_factor:.2f}" for axis in axes))
    table.add_row(
        "requested control current, rms and peak (A)",
        *(f"{axis.command_rms:.2f}, {axis.command_peak:.2f}" for axis in axes),
        f"{min(found.current_limit, found.bias_current):.2f}",
    )
    table.add_row(
        "its slew, rms and peak (kA/s)",
        *(f"{1e-3 * axis.slew_rms:.2f}, {1e-3 * axis.slew_peak:.2f}" for axis in axes),
        "none" if found.slew_rate is None else f"{1e-3 * found.slew_rate:.2f}",
    )
    table.add_row("time above the current limit", *(f"{100 * axis.limited:.2f} %" for axis in axes))
    return table


def _trial_line(trial: Trial) -> str:
    x, y = UM * trial.bias_shift
    begins = "".join(f", {region.name} from {onset.time:.2f} s onwards" for region, onset in trial.onsets.items())
    colour = "green" if trial.region == 0 else "yellow"
    return f"[{colour}]simulation: region {trial.region.name}[/{colour}] (bias moved by {x:.2f} and {y:.2f} um{begins})"


def _design_table(designed: DesignedExcitation) -> Table:

    persistence = designed.persistence
    table = Table("quantity", "value", title=f"Designed {designed.signal.kind}")
    table.add_row("amplitude", f"{UM * designed.amplitude:.3f} um")
    table.add_row("largest in region A by simulation", f"{UM * designed.largest_amplitude:.3f} um")
    table.add_row("largest by the map", f"{UM * designed.predicted_amplitude:.3f} um")
    table.add_row("simulations", str(len(designed.tried)))
    table.add_row("lines", ", ".join(map(str, persistence.lines)) + f" ({', '.join(persistence.axes)})")
    table.add_row("persistently exciting of order", f"{persistence.order}, needed {persistence.wanted}")
    return table


def _write(out: Path, summary: dict[str, Any], found: ExcitationCheck, region_map: RegionMap, console: Console) -> None:
    """Summary and figure."""
    write_json(out / "summary.json", summary)
    overlay_chart(found, region_map).save(out, "overlay")
    console.print(f"summary.json, overlay.png, overlay.html: {out}")
