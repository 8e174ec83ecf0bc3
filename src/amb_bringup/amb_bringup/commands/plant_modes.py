"""`amb plant modes`, `campbell` and `shaft`: modes of a parameter file's machine, and the file of modes of a shaft."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from amb_bringup.commands.inputs import load_loop, parameter_file
from amb_bringup.commands.options import ParamsOption, quantity_option
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder, make_place, write_json
from amb_bringup.commands.terminal import Terminal
from amb_core.linear.model.modes import Modes, modes_of
from amb_core.plant import Plant, linearize, uniform_shaft
from amb_core.plant.campbell import Campbell
from amb_core.plant.campbell import campbell as compute_campbell

RPM = 60.0


def modes(
    params: ParamsOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, values in SI units, instead of tables.")] = False,
) -> None:
    """Print the modes of the closed loop and of the plant alone: frequency, damping, whirl direction and shape."""
    plant_parameters, controller = load_loop(params)
    model = linearize(Plant(plant_parameters), controller)
    modes_by_system = {"closed loop": modes_of(model.closed_loop), "plant without loop": modes_of(model.discrete)}
    if as_json:
        content = {name.split()[0]: part.selected().to_json() for name, part in modes_by_system.items()}
        typer.echo(json.dumps(content, indent=2))
        return
    console = Terminal()
    rpm = RPM * plant_parameters.rotor.running_speed
    for name, part in modes_by_system.items():
        console.print(modes_table(part.selected(), f"{parameter_file(params)}, {name}, {rpm:g} rpm"))


def modes_table(modes: Modes, title: str) -> Table:
    """A row per mode; the shape as magnitude and phase at each sensor."""
    table = Table("mode", "natural (Hz)", "damped (Hz)", "damping ratio", "whirl", title=title)
    for name in modes.output_names:
        table.add_column(name, justify="right")
    for mode in modes.modes:
        shape = [f"{abs(value):.2f} @ {np.degrees(np.angle(value)):.0f}" for value in mode.shape.tolist()]
        unstable = "" if mode.stable else " unstable"
        table.add_row(
            mode.kind or "-",
            f"{mode.natural_hz:.5g}",
            f"{mode.damped_hz:.5g}",
            f"{mode.damping_ratio:.4f}{unstable}",
            mode.whirl,
            *shape,
        )
    table.caption = "shape: displacement @ phase in degrees, the largest is 1"
    if modes.unstable_without_mode:
        table.caption += f"\n{modes.unstable_without_mode} poles beyond half the sample rate, unstable"
    return table


def campbell(
    params: ParamsOption = None,
    max_speed: Annotated[float, typer.Option(help="Highest running speed, in rpm.", min=1.0, max=300_000.0)] = 12_000.0,
    speeds: Annotated[int, typer.Option(help="Number of running speeds, from 0 to the highest.", min=2)] = 25,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("results/plant"),
) -> None:
    """Compute the Campbell diagram: modes of the closed loop over the running speed, and the critical speeds."""
    from amb_core.report.figures.campbell import campbell_chart

    plant_parameters, controller = load_loop(params)
    make_folder(out)
    console = Terminal()
    with Stages(console, "speeds") as stages:
        diagram = compute_campbell(
            plant_parameters,
            controller,
            np.linspace(0.0, max_speed / RPM, speeds),
            stages.update,
        )
    write_json(out / "campbell.json", diagram.to_json())
    image, page = campbell_chart(diagram).save(out, "campbell")
    console.print(_critical(diagram))
    for remark in diagram.remarks:
        console.print(remark, style="yellow", soft_wrap=True)
    if not diagram.stable:
        console.print("the loop is unstable at some of the speeds", style="yellow")
    for path in (image, page, out / "campbell.json"):
        console.print(f"written to {path}", highlight=False, soft_wrap=True)


def _critical(diagram: Campbell) -> Table:
    table = Table("critical speed (rpm)", "mode", "whirl", "damping ratio", "amplification")
    for item in diagram.critical_speeds:
        note = " (critically damped)" if item.critically_damped else ""
        table.add_row(
            f"{item.rpm:.0f}",
            item.kind or "-",
            item.whirl,
            f"{item.damping_ratio:.4f}",
            f"{item.amplification:.3g}{note}",
        )
    return table


def shaft(
    length: Annotated[float, quantity_option("m", "Length of the shaft, in m.")],
    diameter: Annotated[float, quantity_option("m", "Its diameter, in m.")],
    bearings: Annotated[
        float, quantity_option("m", "Distance of both bearings and their sensors from its middle, in m.")
    ],
    bending_modes: Annotated[int, typer.Option(help="Bending modes in each plane, 0 to 8.")] = 3,
    damping_ratio: Annotated[float, typer.Option(help="Damping ratio of the bending modes.")] = 0.005,
    out: Annotated[Path, typer.Option(help="File of modal data, .npz.")] = Path("results/shaft.npz"),
) -> None:
    """Write the modes of a uniform steel shaft as modal data for a flexible rotor."""
    data = uniform_shaft(
        length, diameter, (-bearings, bearings), bending_modes=bending_modes, damping_ratio=damping_ratio
    )
    make_place(out, (".npz",))
    data.save(out)
    bending = ", ".join(f"{value:.4g} Hz" for value in data.natural_frequencies[4::2]) or "none"
    typer.echo(f"bending: {bending}; written to {out}")
