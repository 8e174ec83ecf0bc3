"""The command line `amb`: puts the commands together, and turns errors meant for the user into one line."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from amb_bringup.commands import (
    bag,
    compare,
    demo,
    excitation,
    graph,
    identify,
    map,
    plant,
    regions,
    report,
    reproduce,
    subharmonics,
    validate,
)
from amb_bringup.exit_codes import INTERRUPTED
from amb_core.errors import AmbError


class Commands(TyperGroup):
    """The commands, any of which ends on Ctrl-C with one line and the exit code that shells expect."""

    def invoke(self, ctx: Any) -> Any:  # typer has a copy of click's types of its own
        """Run the command that was asked for."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            typer.echo("amb: interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="amb",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"amb {version('amb_bringup')}")
        raise typer.Exit


@app.callback()
def amb(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Workbench for active magnetic bearings on ROS 2: levitate, excite, record, identify."""


app.command()(demo.demo)
app.command()(graph.up)
app.command(context_settings={"allow_extra_args": True, "allow_interspersed_args": False})(graph.run)
app.command()(identify.identify)
app.command()(validate.validate)
app.command()(compare.compare)
app.command("map")(map.region_map)
app.command()(regions.regions)
app.command()(report.report)
app.command()(reproduce.reproduce)
app.command()(subharmonics.subharmonics)
app.add_typer(bag.app, name="bag")
app.add_typer(excitation.app, name="excitation")
app.add_typer(plant.app, name="plant")


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    try:
        app()
        return 0
    except AmbError as problem:
        print(f"amb: {problem}", file=sys.stderr)
        return 1
