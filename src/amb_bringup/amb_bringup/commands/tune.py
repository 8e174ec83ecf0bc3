"""`amb tune`: gains of a parameter file: suggested ones, and a chart of those that are stable."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from amb_bringup.commands.inputs import load_loop
from amb_bringup.commands.progress import Stages, working
from amb_bringup.commands.results import make_folder, make_place
from amb_bringup.commands.terminal import Terminal
from amb_bringup.graph.parameter_changes import changed_file
from amb_core.designs.tuning import HIGHEST_PEAK, Tuned, reason, tune
from amb_core.designs.tuning.stability_chart import POINTS, stability_chart
from amb_core.ground.errors import PlantError

app = typer.Typer(help="Suggest PD gains, or draw which are stable.", no_args_is_help=True)

Params = Annotated[Path, typer.Argument(metavar="PARAMS", help="Parameter file of all nodes.")]


@app.callback()
def tune_group() -> None:
    """Suggest PD gains, or draw which are stable."""


@app.command()
def chart(
    params: Params,
    points: Annotated[int, typer.Option(help="Gains along each side of the chart.", min=8, max=400)] = POINTS,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("results/tune"),
) -> None:
    """Draw over K_P and K_D where the loop is stable, lines of peak sensitivity 2, 3 and 4, and the chosen gains.

    The loop is linearised with the rotor in the centre; sampling, delay, amplifiers and sensors are in it.
    """
    from amb_core.report.figures import stability_figure

    plant, controller = load_loop(params)
    make_folder(out)
    console = Terminal()
    with Stages(console, "rows") as stages:
        stability = stability_chart(plant, controller, points, stages.update)
    known = np.isfinite(stability.chosen_peak)
    if stability.alike:
        loop = f"K_P = {stability.chosen[0]:.4g} A/m, K_D = {stability.chosen[1]:.4g} A s/m"
    else:
        console.print(f"the axes have gains of their own; the chart has those of {stability.axis} on all")
        loop = "with the gains of all axes"
    console.print(
        f"{loop}: "
        + (f"peak sensitivity {stability.chosen_peak:.3g}" if known else "unstable; amb tune gains suggests others"),
        highlight=False,
    )
    stability_figure(stability).save(out, "stability")
    console.print(f"stability.png, stability.html: {out}")


@app.command()
def gains(
    params: Params,
    out: Annotated[
        Path | None, typer.Option(help="Also write the parameter file with these gains, .yaml.", show_default=False)
    ] = None,
) -> None:
    """Suggest PD gains for the plant of a parameter file, and print their stiffness, damping and margins."""
    plant, controller = load_loop(params)
    if out is not None:
        make_place(out, (".yaml", ".yml"))
    console = Terminal()
    with working(console, "searching gains"):
        tuned = tune(plant, controller)
    if tuned is None:
        raise PlantError(f"no PD gains stabilise this machine: {reason(plant, controller)}")
    console.print(gains_table(tuned, f"PD gains for {params}"))
    if tuned.peak_sensitivity > HIGHEST_PEAK:
        console.print(
            f"no PD gains have a peak sensitivity of at most {HIGHEST_PEAK:g}: {reason(plant, controller)}",
            style="yellow",
        )
    if out is not None:
        changed_file(params, _changes(tuned), out)
        console.print(f"written to {out}", highlight=False)


def _changes(tuned: Tuned) -> list[str]:
    """The gains as `--set` takes them."""
    values = tuned.controller.model_dump()
    names = ("proportional_gain", "derivative_gain", "proportional_gains", "derivative_gains", "nominal_reference")
    texts = {name: values[name] for name in names}
    return [
        f"controller.{name}={list(value) if isinstance(value, tuple) else value!r}" for name, value in texts.items()
    ]


def gains_table(tuned: Tuned, title: str) -> Table:
    """Gains with stiffness, damping and margins."""
    controller, (low, high) = tuned.controller, tuned.gain_margins
    table = Table("quantity", "value", title=title)
    k_p, k_d = (
        values[0] if values else value
        for values, value in (
            (controller.proportional_gains, controller.proportional_gain),
            (controller.derivative_gains, controller.derivative_gain),
        )
    )
    table.add_row("proportional gain K_P", f"{k_p:g} A/m")
    table.add_row("derivative gain K_D", f"{k_d:g} A s/m")
    table.add_row("stiffness at low frequency", f"{1e-6 * tuned.stiffness:.3g} N/um")
    table.add_row("damping at low frequency", f"{tuned.damping:.3g} N s/m")
    mode = tuned.model.rigid_mode(tuned.model.closed_loop.output_names[0])
    if mode is not None:
        table.add_row("natural frequency, damping ratio", f"{mode.natural_hz:.1f} Hz, {mode.damping_ratio:.3f}")
    table.add_row("peak sensitivity", f"{tuned.peak_sensitivity:.3g}")
    upper = f"{high:.3g}" if np.isfinite(high) else "more than 1000"
    table.add_row("stable with both gains times", f"{low:.3g} to {upper}")
    table.add_row("phase margin, guaranteed by the peak", f"{tuned.least_phase_margin:.0f} deg")
    table.add_row(
        "control current that carries the weight", f"{tuned.holding_current:.3g} A of {controller.current_limit:.3g} A"
    )
    return table
