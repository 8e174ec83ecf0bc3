"""`amb distortion`: how much of the rotor's motion no linear model can explain, in a recording or by simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import load_loop
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import Stages, working
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.commands.validate import FirstStepOption, RunOption, StepsOption
from amb_core.data.analysis import evidence_of_run
from amb_core.ground.errors import SpectrumError
from amb_core.ground.parameters import part_of
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions.distortion import Coherence, Distortion, DistortionSettings, simulate_distortion


@data_options
@declared_options({"Multisine, of the simulation": [DistortionSettings]})
def distortion(
    files: DataOptions,
    given: dict[str, Any],
    recording: Annotated[
        Path | None,
        typer.Argument(
            metavar="[BAG]",
            help="Bag, or a data file (.csv, .mat, .npz, .parquet ...); without it the bearing is simulated.",
            show_default=False,
        ),
    ] = None,
    run: RunOption = None,
    first_step: FirstStepOption = -1,
    steps: StepsOption = 0,
    params: ParamsOption = None,
    out: Annotated[Path, typer.Option(help="Folder for summary.json and figures.")] = Path("results/distortion"),
) -> None:
    """Measure nonlinear distortion: how much of the rotor's motion no linear model can explain.

    Random-phase odd multisines excite both axes. Distortions of even order show at even lines, those of odd order at
    odd lines that are not excited. A recording needs two periods or more of such a multisine; of any other, the
    coherence of position and reference is given, which mixes noise and distortion.
    """
    console = Terminal()
    if recording is None:
        _refuse("a recording", {"--run": run is not None, "--first-step": first_step != -1, "--steps": steps != 0})
        _refuse("a recording", dict.fromkeys(files.given, True))
        _simulate(console, part_of(DistortionSettings, given), *load_loop(params), out)
    else:
        names = {f"--{name.replace('_', '-')}": True for name in given}
        _refuse("the simulation", names | {"--params or --set": params is not None})
        _measure(console, files, recording, (run, first_step, steps), out)


def _refuse(only_for: str, given: dict[str, bool]) -> None:
    if wrong := [name for name, present in given.items() if present]:
        raise SpectrumError(f"{wrong[0]} is for {only_for} only")


def _simulate(
    console: Console, settings: DistortionSettings, plant: PlantParameters, controller: ControllerParameters, out: Path
) -> None:
    from amb_core.report.figures.distortion import distortion_chart

    make_folder(out)
    with Stages(console) as stages:
        distortion = simulate_distortion(plant, controller, settings, stages.update)
    console.print(_table(distortion))
    write_json(out / "summary.json", {"settings": settings.model_dump(), **distortion.as_dict()})
    distortion_chart(distortion).save(out, "distortion")
    console.print(f"summary.json, figures: {out}")


def _measure(console: Console, files: DataOptions, path: Path, chosen: tuple[int | None, int, int], out: Path) -> None:
    from amb_core.report.figures.coherence import coherence_chart
    from amb_core.report.figures.distortion import distortion_chart

    recording, _ = files.recording(console, path)
    with working(console, f"measuring {path}"):
        evidence = evidence_of_run(recording, *chosen)
    if evidence.distortion is None and evidence.coherence is None:
        raise SpectrumError(f"{path}: {'; '.join(dict.fromkeys([evidence.problem, evidence.coherence_problem]))}")
    make_folder(out)
    if evidence.distortion is not None:
        console.print(_table(evidence.distortion))
        console.print(_conditions(evidence.distortion))
        distortion_chart(evidence.distortion).save(out, "distortion")
    else:
        console.print(f"no distortion: {evidence.problem}", style="yellow", highlight=False)
    if evidence.coherence is not None:
        console.print(_coherence_table(evidence.coherence))
        coherence_chart(evidence.coherence).save(out, "coherence")
    if evidence.tones:
        console.print(evidence.lines[-1])
    write_json(out / "summary.json", {"recording": str(path), **evidence.as_dict()})
    console.print(f"summary.json, figures: {out}")


def _table(distortion: Distortion) -> Table:
    table = Table("axis", "distortion", "", "even order", "odd order", "noise of a period")
    table.title = "over the linear response"
    for axis, values in distortion.as_dict().items():
        level = values["distortion_db"]
        table.add_row(
            axis,
            _percent(values["distortion_percent"]),
            "none found" if level is None else f"{level:.1f} dB",
            *(_percent(values[f"{part}_percent"]) for part in ("even", "odd", "noise")),
        )
    return table


def _conditions(distortion: Distortion) -> str:
    text = (
        f"{distortion.method} method: experiments with references of their own: {distortion.experiments}, periods "
        f"measured in each: {distortion.periods} or more, of {distortion.period:g} s"
    )
    if not distortion.complete:
        text += "; all odd lines are excited, so distortion of odd order is hidden and not counted"
    return text


def _coherence_table(coherence: Coherence) -> Table:
    table = Table("axis", "coherence", "lowest of a band", "noise and distortion over the rest")
    table.title = f"coherence of position and reference, bands of {coherence.width:.3g} Hz"
    for axis, values in coherence.as_dict().items():
        table.add_row(
            axis,
            *(("-" if part is None else f"{part:.4f}") for part in (values["coherence"], values["lowest_coherence"])),
            _percent(values["noise_and_distortion_percent"]),
        )
    return table


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g} %"
