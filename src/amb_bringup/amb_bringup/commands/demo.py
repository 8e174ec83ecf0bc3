"""`amb demo`: the paper's main experiment from start to figures."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.inputs import parameter_file
from amb_bringup.commands.options import ParamsOption
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import make_folder
from amb_bringup.demo import DemoSummary, run_demo
from amb_bringup.launcher import own_domain
from amb_bringup.node_parameters import check_parameter_file


def demo(
    out: Annotated[Path, typer.Option(help="Folder for bag, model, figures and summary.")] = Path("results/demo"),
    params: ParamsOption = None,
) -> None:
    """Levitate the bearing over ROS 2 topics, shake it with square waves, record, identify, validate.

    Results of an earlier demo in the folder are replaced. The graph runs in its own DDS domain, or in ROS_DOMAIN_ID.
    """
    console = Console()
    check_parameter_file(parameter_file(params))  # a wrong file must not delete the results of an earlier demo
    make_folder(out)
    _clear(out)
    with Stages(console) as stages:
        summary = run_demo(out, parameter_file(params).absolute(), own_domain(), stages.update)
    console.print(_table(summary))
    console.print(f"bag, model.json, summary.json, orbit and response as .png and .html: {out}")


def _clear(folder: Path) -> None:
    """Remove the results of a demo, and nothing else."""
    shutil.rmtree(folder / "bag", ignore_errors=True)
    for name in ("model.json", "orbit.png", "orbit.html", "response.png", "response.html", "summary.json"):
        (folder / name).unlink(missing_ok=True)


def _table(summary: DemoSummary) -> Table:

    table = Table("quantity", "value", title="The bearing over ROS 2 topics")
    table.add_row("steps over topics", f"{summary.steps:,} in {summary.wall_s:.1f} s ({summary.steps_per_s:,.0f} 1/s)")
    table.add_row("node processes", str(summary.processes))
    table.add_row("samples equal to those without ROS", "bit for bit" if summary.bit_identical else "[red]NO[/red]")
    table.add_row("sag", f"{summary.sag_um:.1f} um")
    table.add_row("natural frequency, x", f"{summary.closed_loop_natural_hz:.1f} Hz")
    table.add_row("damping ratio, x", f"{summary.damping_ratio:.3f}")
    table.add_row("model order", str(summary.order))
    table.add_row("closed-loop fit", f"x {summary.fit_x:.2f} %, y {summary.fit_y:.2f} %")
    table.add_row("unstable plant poles", str(summary.unstable_poles))
    return table
