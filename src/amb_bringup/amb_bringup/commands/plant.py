"""`amb plant`: constants, effects, figures and modes of the plant of a parameter file, without a running graph."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from amb_bringup.commands import plant_modes, plant_ross
from amb_bringup.commands.inputs import parameter_file
from amb_bringup.commands.options import ParamsOption
from amb_bringup.commands.results import make_folder
from amb_bringup.commands.terminal import Terminal, say
from amb_controller_node.parameters import PdControllerParameters
from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import SourcedValue, load_parameters, shown_value
from amb_core.plant import PlantDescription
from amb_core.plant import describe as describe_plant
from amb_core.plant.description import Entry, values_with_sources
from amb_sim_node.parameters import SimulatorParameters

app = typer.Typer(help="Describe or plot the plant of a parameter file.", no_args_is_help=True)


@app.callback()
def plant() -> None:
    """Describe or plot the plant of a parameter file."""


@app.command()
def describe(
    params: ParamsOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, values in SI units, instead of tables.")] = False,
) -> None:
    """Print constants and effects of bearing and loop, and which values the paper states or contradicts."""
    path = parameter_file(params)
    plant_parameters = load_parameters(SimulatorParameters, path, "simulator")
    controller = load_parameters(PdControllerParameters, path, "pd_controller")
    description = describe_plant(plant_parameters, controller)
    values = values_with_sources(plant_parameters, controller)
    if as_json:
        typer.echo(_json(description, values))
        return

    console = Terminal()
    console.print(_constants(description.entries, str(path)))
    console.print(_effects(description.effects.entries))
    console.print(_values(values))


@app.command()
def figures(
    params: ParamsOption = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("results/plant"),
) -> None:
    """Draw the iron's magnetisation, the static force, and the force over frequency."""
    from amb_core.plant import figures as plant_figures

    path = parameter_file(params)
    parameters = load_parameters(SimulatorParameters, path, "simulator")
    make_folder(out)
    for name, draw in (
        ("iron", plant_figures.iron_figure),
        ("force", plant_figures.force_figure),
        ("bandwidth", plant_figures.bandwidth_figure),
    ):
        try:
            figure = draw(parameters)
        except PlantError as problem:
            say(f"{name}: not drawn: {problem}", err=True)
            continue
        figure.savefig(out / f"{name}.png")
        typer.echo(f"written to {out / f'{name}.png'}")


app.command()(plant_modes.modes)
app.command()(plant_modes.campbell)
app.command()(plant_modes.shaft)
app.command()(plant_ross.ross)


def _json(description: PlantDescription, values: list[SourcedValue]) -> str:

    def listed(entries: list[Entry]) -> dict[str, dict[str, object]]:
        return {entry.name: {key: value for key, value in asdict(entry).items() if key != "name"} for entry in entries}

    return json.dumps(
        {
            "constants": listed(description.entries),
            "effects": listed(description.effects.entries),
            "parameters": {one.name: {"value": one.value, "unit": one.unit, "source": one.source} for one in values},
        },
        indent=2,
    )


def _constants(entries: list[Entry], title: str) -> Table:

    table = Table("constant", "value", "unit", "meaning", title=title)
    table.columns[1].justify = "right"
    for entry in entries:
        table.add_row(entry.name, *_prefixed(entry.value, entry.unit), entry.meaning)
    return table


def _effects(entries: list[Entry]) -> Table:

    table = Table("effect", "state", "meaning")
    for entry in entries:
        table.add_row(entry.name, "on" if entry.value else "off", entry.meaning)
    return table


def _values(values: list[SourcedValue]) -> Table:

    table = Table(
        "parameter", "value", "unit", "source", title="The paper states these values, or others, or they are assumed"
    )
    table.columns[1].justify = "right"
    for one in values:
        table.add_row(one.name, shown_value(one.value), one.unit, one.source)
    return table


def _prefixed(value: float | bool | None, unit: str) -> tuple[str, str]:
    """A value with four digits and its unit, with a suitable SI prefix."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value], unit
    # Numbers without a unit and rates in 1/s have no prefix.
    scales = [(1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u")] if unit[0].isalpha() else [(1.0, "")]
    scale, prefix = next((pair for pair in scales if abs(value) >= pair[0]), scales[-1] if value else (1.0, ""))
    return f"{value / scale:.4g}", prefix + unit
