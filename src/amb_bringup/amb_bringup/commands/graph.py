"""`amb up` and `amb run`: start the node graph, or one node."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from amb_bringup.commands.options import ParamsOption
from amb_core.ground.errors import ParameterError
from amb_core.ground.files.parameter_files import CONTROLLERS, nodes_with
from amb_core.ground.plain_text import plain_text
from amb_ros import network as network_of_graph

if TYPE_CHECKING:
    from amb_bringup.graph.launcher import Graph
    from amb_bringup.graph.readiness import Readiness

NetworkOption = Annotated[
    bool,
    typer.Option("--network", help="Let other hosts of the network reach the nodes; by default only this host can."),
]
READY_WITHIN = 60.0
"""Wall-clock time after which missing parts are reported (s); on a slow machine the nodes take about ten seconds."""


def up(
    composed: Annotated[
        bool, typer.Option("--composed", help="Simulator and controller in one process, for a faster loop.")
    ] = False,
    params: ParamsOption = None,
    controller: Annotated[
        str, typer.Option(help="Controller node: pd_controller, or state_space_controller for any linear controller.")
    ] = CONTROLLERS[0],
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="Leave the other nodes running when one has ended.")
    ] = False,
    network: NetworkOption = False,
) -> None:
    """Start all nodes and show their output, until Ctrl-C.

    Reports when the graph is ready, and what to call then. Exit code 0 after Ctrl-C if every node ends correctly. If a
    node ends on its own, the others are stopped and the exit code is 1.
    """
    nodes_with(controller)  # refuses an unknown one
    choose_network(network)
    keep_running(lambda: _graph(composed, params, controller), lambda: _readiness(controller), keep_going)


def choose_network(network: bool) -> None:
    """Open the graph to the network if asked for; warn whenever it is, since DDS asks nobody who they are."""
    if network:
        network_of_graph.open_to_network()
    if not network_of_graph.is_local():
        typer.secho(
            "amb: warning: other hosts of the network can reach the nodes, and command them: levitate, excite, change "
            "gains; nothing is encrypted",
            fg="yellow",
            err=True,
        )


def keep_running(
    make_graph: Callable[[], Graph], make_readiness: Callable[[], Readiness], keep_going: bool = False
) -> None:
    """Run a graph in the foreground until Ctrl-C, and report when it is ready.

    Parameters
    ----------
    make_graph, make_readiness : callable
        Make the graph, and what monitors its start.
    keep_going : bool
        Leave the other nodes running when one has ended.

    Raises
    ------
    typer.Exit
        With code 1 if a node ends on its own, or not cleanly.
    """
    reported: dict[str, int] = {}
    graph: Graph | None = None
    try:
        graph = make_graph()
        with graph:
            _watch(graph, reported, keep_going, make_readiness)
    except KeyboardInterrupt:
        typer.echo("amb: stopped", err=True)
    codes = graph.ended() if graph is not None else {}
    ended = (0, -signal.SIGTERM)  # the latter if the node did not handle signals yet
    unclean = {name: code for name, code in codes.items() if name not in reported and code not in ended}
    for name, code in unclean.items():
        _report_end(name, code, " when asked to stop")
    if reported or unclean:
        raise typer.Exit(1)


def shown_graph(name: str, arguments: dict[str, str], params: Path | None) -> Graph:
    """The graph of a launch file with its output on the terminal, after a check that its nodes take the parameters."""
    from amb_bringup.graph.launcher import Graph, launch_file

    def show(node: str, text: str) -> None:
        typer.echo(f"{typer.style(f'[{node}]', fg='cyan')} {plain_text(text)}")

    if params is not None:
        from amb_bringup.graph.node_parameters import check_parameter_file

        check_parameter_file(params)  # one line here; six from the nodes, and a traceback from rcl
        arguments = {**arguments, "params": str(params.absolute())}
    return Graph.from_launch_file(launch_file(name), arguments, output=show)


def _graph(composed: bool, params: Path | None, controller: str) -> Graph:
    """The graph of a loop to start."""
    if composed and controller != CONTROLLERS[0]:
        raise ParameterError(f"--composed --controller {controller} is not allowed; allowed: {CONTROLLERS[0]}")
    if composed:
        return shown_graph("composed", {}, params)
    return shown_graph("bearing", {"controller": controller}, params)


def _watch(graph: Graph, reported: dict[str, int], keep_going: bool, make_readiness: Callable[[], Readiness]) -> None:
    """Report when the graph is ready, and every node that ends, until one or (`keep_going`) all have ended."""
    readiness: Readiness | None = None
    try:
        began, warned, ready = time.monotonic(), False, False
        while len(reported) < len(graph.processes) and (keep_going or not reported):
            for name, code in graph.wait(0.2).items():
                if name not in reported:
                    reported[name] = code
                    _report_end(name, code)
            if ready or reported:
                continue
            if readiness is None:
                readiness = make_readiness()
            missing = readiness.missing(0.1)
            if not missing:
                ready = True
                typer.secho(f"amb: {readiness.message()}", fg="green")
                readiness.close()
            elif not warned and time.monotonic() > began + READY_WITHIN:
                warned = True
                typer.secho(f"amb: not ready yet, still missing: {missing}", fg="yellow", err=True)
    finally:
        if readiness is not None and not ready:
            readiness.close()


def _readiness(controller: str) -> Readiness:
    from amb_bringup.graph.readiness import LoopReadiness  # takes seconds to import while the nodes start

    return LoopReadiness(controller)


def _report_end(name: str, code: int, when: str = "") -> None:
    from amb_bringup.graph.launcher import describe_end

    typer.secho(f"amb: {describe_end(name, code)}{when}", fg="red", err=True)


def run(
    context: typer.Context,
    package: Annotated[str, typer.Argument(help="Name of a package, such as amb_sim_node.")],
    executable: Annotated[str, typer.Argument(help="One of its executables, such as simulator.")],
) -> None:
    """Run one executable of a package, as `ros2 run` does; further arguments are passed on (--ros-args ...)."""
    import os

    from amb_bringup.graph.packages import find_executable

    path = str(find_executable(package, executable))
    os.execv(path, [path, *context.args])
