"""`amb demo`: the paper's main experiment from start to figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.inputs import parameter_file
from amb_bringup.commands.options import ParamsOption
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder
from amb_bringup.commands.terminal import Terminal
from amb_core.ground.parameters import load_parameters

if TYPE_CHECKING:
    from amb_bringup.demos.demo import DemoSummary
    from amb_bringup.demos.machine_demo import MachineDemoSummary


def demo(
    out: Annotated[Path, typer.Option(help="Folder for bag, model, figures and summary.")] = Path("results/demo"),
    params: ParamsOption = None,
) -> None:
    """Levitate the bearing over ROS 2 topics, shake it with square waves, record, identify, validate.

    In a bearing with less clearance than the paper's, 250 um, the squares are smaller in proportion. Magnets that pull
    along y only are refused.

    A machine of more than two axes is excited with an orthogonal multisine; its model is compared with the linearised
    plant by frequency response and modes.

    Results of an earlier demo in the folder are replaced. The graph runs in its own DDS domain, or in ROS_DOMAIN_ID.
    """
    from amb_bringup.demos.demo import require_two_axes, run_demo
    from amb_bringup.demos.machine_demo import run_machine_demo
    from amb_bringup.graph.launcher import own_domain
    from amb_bringup.graph.node_parameters import check_parameter_file
    from amb_core.plant.machine import machine_of
    from amb_sim_node.parameters import SimulatorParameters

    console = Terminal()
    check_parameter_file(parameter_file(params))
    path = parameter_file(params).absolute()
    plant = load_parameters(SimulatorParameters, path, "simulator")
    axes = len(machine_of(plant).axes)
    if axes == 2:
        require_two_axes(plant)
    domain = own_domain()
    make_folder(out)
    with Stages(console) as stages:
        if axes == 2:
            console_table = _table(run_demo(out, path, domain, stages.update, clear=True))
        else:
            console_table = _machine_table(run_machine_demo(out, path, domain, stages.update, clear=True))
    console.print(console_table)
    figures = "orbit and response" if axes == 2 else "orbit, response and Bode diagram"
    console.print(f"bag, model.json, summary.json, {figures} as .png and .html: {out}")


def _table(summary: DemoSummary) -> Table:

    table = Table("quantity", "value", title="The bearing over ROS 2 topics")
    table.add_row("steps over topics", f"{summary.steps:,} in {summary.wall_s:.1f} s ({summary.steps_per_s:,.0f} 1/s)")
    table.add_row("node processes", str(summary.processes))
    table.add_row("samples equal to those without ROS", "bit for bit" if summary.bit_identical else Text("NO", "red"))
    table.add_row("sag", f"{summary.sag_um:.1f} um")
    table.add_row("natural frequency, x", f"{summary.closed_loop_natural_hz:.1f} Hz")
    table.add_row("damping ratio, x", f"{summary.damping_ratio:.3f}")
    table.add_row("model order", str(summary.order))
    table.add_row("closed-loop fit", f"x {summary.fit_x:.2f} %, y {summary.fit_y:.2f} %")
    table.add_row("unstable plant poles", str(summary.unstable_poles))
    return table


def _machine_table(summary: MachineDemoSummary) -> Table:
    table = Table("quantity", "value", title=f"The machine over ROS 2 topics: {', '.join(summary.axes)}")
    table.add_row("steps over topics", f"{summary.steps:,} in {summary.wall_s:.1f} s ({summary.steps_per_s:,.0f} 1/s)")
    table.add_row("node processes", str(summary.processes))
    table.add_row("samples equal to those without ROS", "bit for bit" if summary.bit_identical else Text("NO", "red"))
    table.add_row("running speed", f"{60.0 * summary.running_speed:.0f} r/min")
    table.add_row("model order", str(summary.order))
    table.add_row("closed-loop fit", ", ".join(f"{name} {value:.2f} %" for name, value in summary.fit.items()))
    table.add_row("unstable plant poles", f"{summary.unstable_poles} (linearised: {summary.unstable_poles_computed})")
    table.add_row("frequency response against the linearised plant", summary.frf_worst)
    for mode in summary.modes:
        table.add_row(
            f"mode in the loop{', ' + mode['kind'] if mode['kind'] else ''}, {mode['computed_whirl']}",
            f"{mode['identified_natural_hz']:.2f} Hz, damping ratio {mode['identified_damping_ratio']:.3f} "
            f"({mode['frequency_error_percent']:+.2f} % of the computed frequency)",
        )
    return table
