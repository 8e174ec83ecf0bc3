"""`amb distortion`: how much of the rotor's motion no linear model can explain, on the simulated bearing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import load_changed_loop
from amb_bringup.commands.options import ChangeOption, ParamsOption, declared_options
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, write_json
from amb_core.distortion import Distortion, DistortionSettings, simulate_distortion
from amb_core.figures.distortion import distortion_chart
from amb_core.parameters import part_of


@declared_options({"Multisine": [DistortionSettings]})
def distortion(
    given: dict[str, Any],
    params: ParamsOption = None,
    change: ChangeOption = None,
    out: Annotated[Path, typer.Option(help="Folder for summary.json and figures.")] = Path("results/distortion"),
) -> None:
    """Measure nonlinear distortion: how much of the rotor's motion no linear model can explain.

    Random-phase odd multisines excite both axes. Distortions of even order show at even lines, those of odd order at
    odd lines that are not excited.
    """
    settings = part_of(DistortionSettings, given)
    loop = load_changed_loop(params, change or [])
    console = Console()
    make_folder(out)
    with Stages(console) as stages:
        found = simulate_distortion(*loop, settings, lambda done, total: stages.update("experiments", done, total))
    console.print(_table(found))
    write_json(out / "summary.json", {"settings": settings.model_dump(), **_values(found)})
    distortion_chart(found).save(out, "distortion")
    console.print(f"summary.json, figures: {out}")


def _table(found: Distortion) -> Table:
    table = Table("axis", "distortion", "", "even order", "odd order", "noise of a period")
    table.title = "over the linear response"
    for axis, values in _values(found).items():
        table.add_row(
            axis,
            f"{values['distortion_percent']:.3g} %",
            f"{values['distortion_db']:.1f} dB" if values["distortion_db"] is not None else "none found",
            *(f"{values[f'{part}_percent']:.3g} %" for part in ("even", "odd", "noise")),
        )
    return table


def _values(found: Distortion) -> dict[str, dict[str, float | None]]:
    """Numbers of each axis; the level in dB is None where no distortion was found."""
    return {
        name: {
            "distortion_percent": 100.0 * float(found.ratio[axis]),
            "distortion_db": float(found.decibel[axis]) if found.ratio[axis] > 0.0 else None,
            "even_percent": 100.0 * float(found.even_ratio[axis]),
            "odd_percent": 100.0 * float(found.odd_ratio[axis]),
            "noise_percent": 100.0 * float(found.noise_ratio[axis]),
        }
        for axis, name in enumerate("xy")
    }
