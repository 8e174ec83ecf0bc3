"""`amb up` and `amb run`: start the node graph, or one node."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Annotated

import typer

from amb_bringup.commands.inputs import ParamsOption


def up(
    composed: Annotated[
        bool, typer.Option("--composed", help="Simulator and controller in one process, for a faster loop.")
    ] = False,
    params: ParamsOption = None,
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="Leave the other nodes running when one has ended.")
    ] = False,
) -> None:
    """Start all nodes and show what they say, until Ctrl-C.

    When a node ends on its own, the others are stopped and the exit code is 1.
    """
    from amb_bringup.launcher import Graph, describe_end, launch_file

    def show(name: str, text: str) -> None:
        typer.echo(f"{typer.style(f'[{name}]', fg='cyan')} {text}")

    arguments = {}
    if params is not None:
        from amb_bringup.node_parameters import check_parameter_file

        check_parameter_file(params)  # here it is one line; from the nodes it would be six, and from rcl a traceback
        arguments["params"] = str(params.absolute())
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)
    reported: dict[str, int] = {}
    graph = Graph.from_launch_file(launch_file("composed" if composed else "bearing"), arguments, output=show)
    try:
        with graph:
            while len(reported) < len(graph.processes) and (keep_going or not reported):
                for name, code in graph.wait(0.2).items():
                    if name not in reported:
                        reported[name] = code
                        typer.secho(f"amb: {describe_end(name, code)}", fg="red", err=True)
    except KeyboardInterrupt:
        typer.echo("amb: stopped", err=True)
    unclean = {name: code for name, code in graph.ended().items() if name not in reported and code not in (0, -2)}
    for name, code in unclean.items():
        typer.secho(f"amb: {describe_end(name, code)} when told to stop", fg="red", err=True)
    if reported or unclean:
        raise typer.Exit(1)


def run(
    context: typer.Context,
    package: Annotated[str, typer.Argument(help="Name of a package, such as amb_sim_node.")],
    executable: Annotated[str, typer.Argument(help="One of its executables, such as simulator.")],
) -> None:
    """Run one executable of a package, as `ros2 run` does; what follows is passed on (--ros-args ...)."""
    import os

    from amb_bringup.packages import find_executable

    path = str(find_executable(package, executable))
    os.execv(path, [path, *context.args])


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
