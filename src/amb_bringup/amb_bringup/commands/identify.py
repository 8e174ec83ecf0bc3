"""`amb identify`: from a bag to a model, without a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from amb_core.identification import Identification


def identify(
    bag: Annotated[Path, typer.Argument(help="Folder of a bag, or an .mcap or .db3 file.")],
    order: Annotated[int, typer.Option(help="Number of states of the model.")] = 10,
    method: Annotated[str, typer.Option(help="pem, ssarx, pbsid, cva, n4sid or moesp.")] = "pem",
    first_step: Annotated[int, typer.Option(help="First step used; -1 for where the last excitation starts.")] = -1,
    steps: Annotated[int, typer.Option(help="Number of steps used; 0 for all to the end of the excitation.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Write the model here, as .json or .npz.")] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Write response and orbit, plant and model together, to this folder (PNG and HTML)."),
    ] = None,
) -> None:
    """Identify the plant from the last experiment in a bag and check the model in closed loop on the same data."""
    from rich.console import Console

    from amb_core import identification
    from amb_core.bags import read_bag
    from amb_core.figures import save_loop_figures

    console = Console()
    content = read_bag(bag)
    if content.truncated:
        console.print(f"[yellow]bag {bag} is incomplete: {content.truncated}[/yellow]")
    record = content.experiment(first_step, steps)
    controller = content.controller_parameters()
    if controller is None:
        console.print("[yellow]the bag lacks the controller's parameters; those of the paper are assumed[/yellow]")
    with console.status(f"identifying order {order} from {record.steps} samples"):
        result = identification.identify(record, order, method, controller, source=str(bag))
    console.print(_summary(result))
    if out is not None:
        result.model.save(out)
        console.print(f"model: {out}")
    if figures is not None:
        save_loop_figures(figures, record, result.simulations[0])
        console.print(f"response and orbit, .png and .html: {figures}")


def _summary(result: Identification) -> Table:
    """The model and its validation as a table; poles as continuous-time rates in 1/s, s = ln(z) / T."""
    import numpy as np
    from rich.table import Table

    model = result.model
    first, last = result.data.experiments[0].first_step, result.data.experiments[0].stop - 1
    unstable = model.unstable_poles()
    table = Table("quantity", "value", title=f"{model.method} from {model.source}")
    table.add_row("order", str(model.order))
    table.add_row("samples", f"{model.samples}, steps {first} to {last}")
    for name, fit in zip(model.output_names, model.fit, strict=True):
        table.add_row(f"closed-loop fit {name}", f"{fit:.2f} %")
    table.add_row("poles z", "\n".join(_number(pole) for pole in model.poles()))
    rates = ", ".join(f"{_number(np.log(pole) / model.sample_time, 5)} 1/s" for pole in unstable)
    table.add_row("unstable poles", f"{len(unstable)}" + (f": {rates}" if rates else ""))
    table.add_row("closed loop", "stable" if result.stable else "[red]unstable[/red]")
    return table


def _number(value: complex, digits: int = 7) -> str:
    """A pole as text, without an imaginary part where there is none."""
    return f"{value.real:.{digits}g}" if value.imag == 0 else f"{value.real:.{digits}g} {value.imag:+.{digits}g}j"
