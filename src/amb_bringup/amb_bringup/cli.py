"""The command line `amb`: puts the commands together, and turns errors meant for the user into one line."""

from __future__ import annotations

import sys

import typer

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
from amb_core.errors import AmbError

app = typer.Typer(
    name="amb",
    help="Workbench for active magnetic bearings on ROS 2: levitate, excite, record, identify.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
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
