"""`amb rig`: start the nodes of a rig, levitate, land, switch off, and see what the bridge reports."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from amb_bringup.commands.graph import NetworkOption, choose_network, keep_running, shown_graph
from amb_bringup.commands.options import ParamsOption, quantity_option
from amb_bringup.commands.terminal import Terminal
from amb_bringup.exit_codes import CHECK_FAILED
from amb_core.ground.files.parameter_files import RIG_NODES

if TYPE_CHECKING:
    from amb_bringup.client import AmbClient
    from amb_bringup.graph.readiness import Readiness

app = typer.Typer(no_args_is_help=True, help="Work with a rig behind a real-time target, real or emulated.")


@app.command()
def up(
    emulator: Annotated[
        bool, typer.Option("--emulator", help="Start an emulated target on this machine, too.")
    ] = False,
    params: ParamsOption = None,
    network: NetworkOption = False,
) -> None:
    """Start the nodes of a rig and show their output, until Ctrl-C.

    Reports when the graph is ready, and what to call then. Exit codes as those of `amb up`. At its end the rotor is
    landed, unless the parameter `at_exit` of hardware_bridge leaves it levitated.
    """
    choose_network(network)
    if emulator and params is not None:
        from amb_bringup.graph.node_parameters import require_emulated_target

        require_emulated_target(params)
    arguments = {"emulator": str(emulator).lower()}
    keep_running(lambda: shown_graph("rig", arguments, params), _readiness)


@app.command()
def connect(
    patience: Annotated[float, quantity_option("s", "Longest wait for a target that still starts (s).")] = 5.0,
) -> None:
    """Connect the bridge to the target, check it, and send it controller, limits and references."""
    with _client() as amb:
        amb.rig.connect(patience)
        _show(amb)


@app.command()
def levitate() -> None:
    """Levitate the rotor: a run begins."""
    with _client() as amb:
        run = amb.rig.levitate()
        typer.echo(f"levitated: run {run}")
        _show(amb)


@app.command()
def land() -> None:
    """Land the rotor: the excitation fades, the reference goes to the landing one, the currents go off."""
    with _client() as amb:
        amb.rig.land()
        _show(amb)


@app.command()
def off() -> None:
    """Switch the currents off at once, whatever bridge and target do: the rotor falls onto its backup bearings."""
    with _client() as amb:
        amb.rig.off()
        _show(amb)


@app.command()
def disconnect() -> None:
    """Leave the target as it is."""
    with _client() as amb:
        amb.rig.disconnect()


@app.command()
def reset() -> None:
    """Forget latched trips, after their cause has been removed."""
    with _client() as amb:
        amb.rig.reset_faults()
        _show(amb)


@app.command()
def status() -> None:
    """Show the state of bridge and target, positions, lost samples and trips."""
    with _client() as amb:
        _show(amb)


@app.command()
def check(
    address: Annotated[str, typer.Argument(help="Address of the target, or serial:DEVICE.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65_535, help="Its UDP port.")] = 47_000,
    key_file: Annotated[Path | None, typer.Option(help="File with the shared key, mode 0600.")] = None,
    timeout: Annotated[float, quantity_option("s", "Longest wait for an answer (s).")] = 1.0,
) -> None:
    """Check whether a target keeps to AMB-UDP, frame by frame, with the rotor at rest; nothing is levitated.

    No bridge may be connected to the target. Afterwards it has the limits of its configuration, small gains and no
    upload. Exit code 0 if nothing is wrong, 3 otherwise.
    """
    from amb_core.rig.link.conformance import CHECKS, Exchange, check_target
    from amb_core.rig.link.key_file import read_key

    target = Exchange(address, port, read_key(str(key_file)) if key_file is not None else b"", timeout)
    try:
        complaints = check_target(target)
    finally:
        target.close()
    console = Terminal()
    for one in complaints:
        console.print(f"{one.check}: {one.text}", highlight=False, markup=False)
    if complaints:
        raise typer.Exit(CHECK_FAILED)
    console.print(f"{target.where} keeps to AMB-UDP in {len(CHECKS)} checks: {', '.join(CHECKS)}")


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for bag, model, report and summary.")] = Path("results/rig-demo"),
    params: ParamsOption = None,
) -> None:
    """The first session with a rig, on an emulated target in real time: levitate, sweep, identify, land, report.

    Results of an earlier session in the folder are replaced. The graph runs in its own DDS domain, or in ROS_DOMAIN_ID.
    """
    from amb_bringup.commands.inputs import parameter_file
    from amb_bringup.commands.progress import Stages
    from amb_bringup.commands.results import make_folder
    from amb_bringup.demos.rig_demo import run_rig_demo
    from amb_bringup.graph.launcher import own_domain
    from amb_bringup.graph.node_parameters import check_parameter_file, require_emulated_target

    console = Terminal()
    path = parameter_file(params).absolute()
    check_parameter_file(path)
    require_emulated_target(path)
    domain = own_domain()
    make_folder(out)
    with Stages(console) as stages:
        summary = run_rig_demo(out, path, domain, stages.update, clear=True)
    table = Table("quantity", "value", title=f"A session with an emulated rig: {', '.join(summary.axes)}")
    table.add_row("samples", f"{summary.steps:,}, {summary.lost:,} lost, {summary.doubled:,} doubled")
    table.add_row("control steps that the emulated target missed", f"{summary.missed:,}")
    table.add_row("trips", "; ".join(summary.trips) or "none")
    table.add_row("region", f"{summary.region}; highest load on a coarse map {summary.load:.2f}, where A may end at 1")
    table.add_row("model order", str(summary.order))
    table.add_row("closed-loop fit", ", ".join(f"{name} {value:.2f} %" for name, value in summary.fit.items()))
    table.add_row("unstable plant poles", str(summary.unstable_poles))
    table.add_row("frequency response against the linearised plant", summary.frf_worst)
    table.add_row("duration", f"{summary.seconds:.0f} s")
    console.print(table)
    console.print(f"bag, model.json, report.html, summary.json: {out}")


def _readiness() -> Readiness:
    from amb_bringup.graph.readiness import RigReadiness  # takes seconds to import while the nodes start

    return RigReadiness()


def _client() -> AmbClient:
    from amb_bringup.client import AmbClient  # takes a second to import

    return AmbClient(nodes=RIG_NODES)


def _show(amb: AmbClient) -> None:
    from amb_bringup.client.rig import MODES

    state = amb.rig.wait_for_state()
    table = Table("quantity", "value")
    table.add_row("bridge", amb.rig.life_cycle())
    table.add_row("target", MODES[state.mode])
    if state.run:
        table.add_row("run", f"{state.run}, up to step {state.step:,}")
    positions = ", ".join(
        f"{axis} {1e6 * value:.1f} um" for axis, value in zip(state.axes, state.position, strict=False)
    )
    table.add_row("position", positions or "-")
    table.add_row("samples lost, doubled", f"{state.lost:,}, {state.doubled:,}")
    table.add_row("control steps missed", f"{state.missed:,}")
    table.add_row("problem", state.problem or "none")
    for trip in amb.rig.trips:
        table.add_row("trip", trip.text)
    Terminal().print(table)
