"""`amb new`: a parameter file of one's own bearing, with gains that levitate it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from amb_bringup.commands.options import declared_options
from amb_bringup.commands.progress import working
from amb_bringup.commands.results import ResultError, make_place, new_file
from amb_bringup.commands.terminal import Terminal, say
from amb_bringup.commands.tune import gains_table
from amb_bringup.graph.node_parameters import check_parameter_file
from amb_core.designs.tuning import Bearing, BearingDesign, design_bearing, parameter_file_of
from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Declaration, declarations, validate
from amb_core.ground.units import PURE, quantity_of

REQUIRED = tuple(name for name, field in Bearing.model_fields.items() if field.is_required())
ASKED = (*REQUIRED, "sample_rate", "journal_diameter", "length")
"""What is asked for on a terminal; everything else has its default unless it is given."""
EXAMPLES = {"m": "0.4mm", "kg": "3.5kg", "A": "2.5A", "V": "100V", "Hz": "10kHz", PURE: "60"}
HIGHEST_FREQUENCY, BELOW_NYQUIST = 1_500.0, 0.4
"""Highest frequency of the first experiment (Hz), and the largest part of the sample rate that it may be."""


@declared_options({"Bearing": [Bearing]})
def new(
    given: dict[str, Any],
    out: Annotated[Path, typer.Argument(metavar="FILE", help="Parameter file to write, .yaml.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file of this name.")] = False,
) -> None:
    """Write a parameter file of your own bearing, with PD gains that levitate it.

    Asks for what is needed, unless it is given or there is no terminal. The gains come from pole placement on the
    linearised plant; they are checked with sampling, delay, amplifiers and sensors, and in a simulated lift-off. A
    bearing that no PD gains hold with a peak sensitivity of at most 3 is refused, with the reason.
    """
    make_place(out, (".yaml", ".yml"))
    if out.exists() and not overwrite:
        raise ResultError(f"{out}: exists already; give another name, or --overwrite")
    bearing = validate(Bearing, given | _answers(given))
    console = Terminal()
    with working(console, "searching gains, simulating the lift-off"):
        design = design_bearing(bearing)
    with new_file(out, overwrite) as part:
        part.write_text(parameter_file_of(design))
        check_parameter_file(part)
    _show(console, design, out)


def _answers(given: dict[str, Any]) -> dict[str, Any]:
    """Answers to the questions; none if everything needed is given."""
    missing = [name for name in REQUIRED if name not in given]
    if not missing:
        return {}
    if not sys.stdin.isatty():
        options = " ".join(f"--{name.replace('_', '-')}" for name in missing)
        raise ParameterError(f"a bearing needs {options}; see amb new --help")
    declared = {item.name: item for item in declarations(Bearing)}
    return {name: _ask(declared[name]) for name in ASKED if name not in given}


def _ask(item: Declaration) -> float | int:
    """One question, again until the answer is a quantity in the declared range."""
    example = f", as {EXAMPLES[item.unit]}"
    default = None if item.name in REQUIRED else f"{item.default:g}"
    text = f"{item.description}{'' if item.unit == PURE else f' ({item.unit}{example})'}"
    while True:
        answer = typer.prompt(text[:1].upper() + text[1:], default=default)
        try:
            value = quantity_of(str(answer), item.unit)
        except ParameterError as problem:
            say(str(problem), err=True)
            continue
        if item.minimum is not None and item.maximum is not None and item.minimum <= value <= item.maximum:
            if item.type is not int:
                return value
            if value.is_integer():
                return int(value)
        typer.echo(f"{answer} is not allowed; allowed: {item.allowed}", err=True)


def _show(console: Console, design: BearingDesign, out: Path) -> None:
    table = gains_table(design.tuned, f"{out}: a bearing that levitates")
    limit, sizing = design.tuned.controller.current_limit, design.sizing
    table.add_row(
        "flux density, bias and at the current limit",
        f"{sizing.bias_flux_density:.3g}, {sizing.largest_flux_density:.3g} T, linear iron",
    )
    if np.isfinite(sizing.load_ratio):
        table.add_row("force at the current limit, over the weight", f"{sizing.load_ratio:.3g}")
    table.add_row(
        "unstable pole, samples in its time constant", f"{sizing.unstable_pole:.3g} 1/s, {sizing.samples:.3g}"
    )
    table.add_row("slew rate of the force", f"{1e-3 * sizing.force_slew:.3g} N/ms")
    table.add_row("bandwidth of the current loop", f"{sizing.current_bandwidth:.3g} Hz")
    table.add_row("ripple of a coil current", f"{sizing.current_ripple:.3g} A of {sizing.bias_current:.3g} A bias")
    table.add_row("control current that lifts the rotor off", f"{design.lift_off_current:.3g} A of {limit:.3g} A")
    table.add_row("largest control current while it rises", f"{design.lift_off.largest_current:.3g} A of {limit:.3g} A")
    table.add_row("simulated lift-off", f"at rest in the centre after {1e3 * design.lift_off.time:.0f} ms")
    console.print(table)
    for remark in design.remarks:
        console.print(f"note: {remark}", highlight=False)
    console.print(f"written to {out}; next:", highlight=False)
    highest = min(HIGHEST_FREQUENCY, BELOW_NYQUIST * design.tuned.controller.sample_rate)
    for command, does in (
        (f"amb plant describe --params {out}", "its constants"),
        (f"amb tune chart {out}", "which gains are stable"),
        (
            f"amb experiment multisine --amplitude 2um --frequency-end {1e-3 * highest:.4g}kHz --params {out}",
            "levitate, excite, record, report",
        ),
        (f"amb map --params {out}", "where it stays in region A"),
    ):
        console.print(f"  {command:<84} # {does}", highlight=False, soft_wrap=True)
