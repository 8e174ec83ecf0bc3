"""`amb excitation check` and `design`: the regions in which an excitation would run, and the largest within limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.inputs import inputs_of, load_loop, load_regions
from amb_bringup.commands.options import declared_options, quantity_option
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_core.designs.excitation import (
    AxisMeasure,
    DesignedExcitation,
    ExcitationCheck,
    Limits,
    Trial,
    TrialBench,
    check_excitation,
    design_excitation,
    use_of_trial,
)
from amb_core.designs.excitation.notes import made_with
from amb_core.designs.excitation.spans import require_one_bearing
from amb_core.designs.excitation.summary import check_summary, design_summary, trial_summary
from amb_core.excitation import KINDS, excitation_from_settings, generate
from amb_core.ground.errors import RegionError
from amb_core.ground.parameters import part_of
from amb_core.ground.progress import as_stage
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.regions import Region, RegionParameters
from amb_core.regions.region_map import RegionMap

Loop = tuple[ControllerParameters, PlantParameters, RegionParameters | None]


app = typer.Typer(help="Check or design an excitation on a region map.", no_args_is_help=True)

DESIGNED = ("square", "multisine", "prbs")
DURATION = {"duration": 4.0}  # s
NOTES = {"phasing": "by default optimised", "interleaved": "by default true with axes all"}

MapFile = Annotated[Path, typer.Option("--map", help="Region map, as `amb map` writes it.")]
LoopParams = Annotated[
    Path | None,
    typer.Option(help="Parameter file of all nodes.", show_default="the loop that the map was made with"),
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
    signal = generate(excitation_from_settings(kind, given), loop[0].sample_rate)
    checked = check_excitation(signal, region_map, *loop[:2])
    console = Terminal()
    make_folder(out)
    summary: dict[str, Any] = {"map": str(map_file), "parameters": signal.parameters.model_dump()}
    summary["check"] = check_summary(checked)
    _print_check(console, checked)
    if simulate:
        with Stages(console, "steps") as stages:
            bench = TrialBench(loop[1], loop[0], loop[2])
            trial = bench.run(signal, as_stage("simulated", stages.update))
        use = use_of_trial(trial, Limits(), bench.regions.drift_threshold)
        beyond = use.what if use.share > 1.0 else None
        summary["trial"] = trial_summary(trial) | {"beyond_limits": beyond}
        console.print(_trial_line(trial, beyond is None))
        if trial.measures:
            console.print(_measures_table(trial.measures))
        if beyond is not None:
            console.print(f"beyond the limits of a design: {beyond}", style="yellow", highlight=False)
    else:
        console.print("not simulated: the map knows regions, not distortion; --simulate measures it")
    _write(out, summary, checked, region_map, console)


@app.command()
@declared_options(
    {"Signal": [KINDS[kind] for kind in DESIGNED], "Limits": [Limits]},
    leave_out=["amplitude"],
    defaults=DURATION,
    notes=NOTES,
)
def design(
    kind: Annotated[str, typer.Argument(help="square, multisine or prbs.")],
    given: dict[str, Any],
    model_order: Annotated[
        int | None,
        typer.Option(help="States of a model that must be identifiable (-). By default that order is reported only."),
    ] = None,
    margin: Annotated[float, quantity_option("-", "Amplitude over the largest within the limits (-).")] = 0.9,
    tolerance: Annotated[float, quantity_option("-", "Relative error of that largest amplitude (-).")] = 0.02,
    map_file: MapFile = Path("results/map/map.json"),
    params: LoopParams = None,
    out: Out = Path("results/excitation/design"),
) -> None:
    """Find the largest amplitude in region A within limits of distortion, clipping and slew, by simulation."""
    region_map, loop = _load(map_file, params)
    console = Terminal()
    make_folder(out)
    limits = {name: given.pop(name) for name in list(given) if name in Limits.model_fields}
    with Stages(console, "steps") as stages:
        designed = design_excitation(
            kind,
            given,
            region_map,
            *loop,
            limits=part_of(Limits, limits),
            model_order=model_order,
            margin=margin,
            tolerance=tolerance,
            progress=stages.update,
        )
    console.print(_design_table(designed))
    console.print(_measures_table(designed.certificate.worst))
    console.print(designed.verdict, highlight=False)
    assert designed.check is not None
    for note in designed.check.notes:
        console.print(f"note: {note}", style="yellow")
    drawn = replace(designed.check, verdict=designed.verdict)  # the simulations decide, not the map
    _write(
        out,
        {"map": str(map_file), "inputs": inputs_of(map_file), **design_summary(designed)},
        drawn,
        region_map,
        console,
    )


def _load(map_file: Path, params: Path | None) -> tuple[RegionMap, Loop]:
    """The map, and the loop: that of a parameter file, or the one the map was made with."""
    if not _exists(map_file):
        raise RegionError(f"region map {map_file}: there is no such file; `amb map` makes one (results/map/map.json)")
    region_map = RegionMap.load(map_file)
    if params is None:
        regions = made_with(region_map, "regions", RegionParameters) if "regions" in region_map.provenance else None
        controller = made_with(region_map, "controller", ControllerParameters)
        plant = made_with(region_map, "plant", PlantParameters)
    else:
        plant, controller = load_loop(params)
        regions = load_regions(params)
    require_one_bearing(machine_of(plant), "the machine has")
    return region_map, (controller, plant, regions)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # the reader of the file reports what is wrong with the path
        return True


def _print_check(console: Console, checked: ExcitationCheck) -> None:
    colour = {"A": "green" if checked.certain else "yellow", "B": "yellow"}.get(checked.predicted.name, "red")
    console.print(_check_table(checked))
    console.print(checked.verdict, style=colour)
    for note in checked.notes:
        console.print(f"note: {note}", style="yellow")


def _check_table(checked: ExcitationCheck) -> Table:

    axes = checked.axes
    table = Table("quantity", *(axis.axis for axis in axes), "limit", title=f"{checked.kind} on the region map")
    for region in Region:
        table.add_row(f"share of the power in {region.name}", *(f"{100 * axis.shares[region]:.1f} %" for axis in axes))
    for region in (Region.B, Region.C, Region.D):
        table.add_row(f"load towards {region.name}", *(f"{axis.load.towards[region]:.2f}" for axis in axes), "1")
    table.add_row("load, unknown parts counted fully", *(f"{axis.load.linear:.2f}" for axis in axes), "1")
    table.add_row("rms, peak (um)", *(f"{UM * axis.rms:.2f}, {UM * axis.peak:.2f}" for axis in axes))
    table.add_row("crest factor", *(f"{axis.crest_factor:.2f}" for axis in axes))
    table.add_row(
        "control current at rest (A)", *(f"{axis.static_current:.2f}" for axis in axes), f"{checked.current_limit:.2f}"
    )
    table.add_row(
        "control current, rms without and peak with that at rest (A)",
        *(f"{axis.command_rms:.2f}, {axis.command_peak:.2f}" for axis in axes),
        f"{checked.current_limit:.2f}",
    )
    table.add_row(
        "its slew, rms and peak (kA/s)",
        *(f"{1e-3 * axis.slew_rms:.2f}, {1e-3 * axis.slew_peak:.2f}" for axis in axes),
        "none" if checked.slew_rate is None else f"{1e-3 * checked.slew_rate:.2f}",
    )
    table.add_row("samples above the current limit", *(f"{100 * axis.limited:.2f} %" for axis in axes))
    table.add_row("samples beyond the slew limit", *(f"{100 * axis.slewed:.2f} %" for axis in axes))
    return table


def _trial_line(trial: Trial, within: bool) -> Text:
    x, y = UM * trial.bias_shift
    begins = "".join(f", {region.name} from {onset.time:.2f} s onwards" for region, onset in trial.onsets.items())
    colour = "green" if within else "yellow"
    moved = f" (bias moved by {x:.2f} and {y:.2f} um{begins})"
    return Text.assemble((f"simulation: region {trial.region.name}", colour), moved)


def _measures_table(measures: tuple[AxisMeasure, ...]) -> Table:
    table = Table("quantity", *(item.axis for item in measures), title="In simulation")
    table.add_row("deviation from the linear response", *(f"{100 * item.deviation:.2f} %" for item in measures))
    table.add_row("fit of the linearised loop, shift of the mean included", *(f"{item.fit:.1f} %" for item in measures))
    table.add_row("samples with a clipped control current", *(f"{100 * item.clipped:.2f} %" for item in measures))
    table.add_row("samples with a slew beyond the voltage", *(f"{100 * item.slewed:.2f} %" for item in measures))
    return table


def _design_table(designed: DesignedExcitation) -> Table:
    table = Table("quantity", "value", title=f"Designed {designed.signal.kind}")
    table.add_row("amplitude", f"{UM * designed.amplitude:.4g} um")
    table.add_row("largest within the limits", f"{UM * designed.largest_amplitude:.4g} um")
    table.add_row("limited by", designed.limited_by)
    if designed.predicted_amplitude is not None:
        table.add_row("largest in region A by the map", f"{UM * designed.predicted_amplitude:.4g} um")
    if designed.distortion is not None:
        table.add_row("nonlinear distortion, random phases", designed.distortion.summary.partition(": ")[2])
    table.add_row("seeds", str(len(designed.certificate.trials)))
    table.add_row("simulations", str(len(designed.tried)))
    table.add_row("amb identify accepts models of order", str(designed.excited_order))
    return table


def _write(
    out: Path, summary: dict[str, Any], checked: ExcitationCheck, region_map: RegionMap, console: Console
) -> None:
    """Summary and figure."""
    from amb_core.report.figures import overlay_chart

    write_json(out / "summary.json", summary)
    overlay_chart(checked, region_map).save(out, "overlay")
    console.print(f"summary.json, overlay.png, overlay.html: {out}")
