"""`amb identify`: identifies a model from bags or data files, without a running graph."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import numpy as np
import typer
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.columns import EntriesOption
from amb_bringup.commands.inputs import inputs_of, model_order
from amb_bringup.commands.own_data import DataOptions, data_options
from amb_bringup.commands.progress import Stages, working
from amb_bringup.commands.results import make_folder, make_place, names_file, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.commands.validate import load_recorded
from amb_core import identification
from amb_core.data.analysis import RecordedLoop
from amb_core.data.controller_choice import ALLOWED, NO_CONTROLLER, needs_controller
from amb_core.data.experiments import Finding, merge
from amb_core.data.experiments.drift import DriftOption
from amb_core.ground.errors import IdentificationError
from amb_core.ground.results import plain
from amb_core.identification import Focus, Identification, IdentificationData, IdentificationProgress, response_of
from amb_core.identification.identify import check_arguments
from amb_core.identification.validation import Verdict
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController

if TYPE_CHECKING:
    from amb_core.report.figures.entries import Entry

UNITS = 1e6
"""Micrometres in a metre."""

MODEL_ENDINGS = (".json", ".npz", ".mat")


@data_options
def identify(
    files: DataOptions,
    bag: Annotated[
        list[Path],
        typer.Argument(help="Bags, or data files (.csv, .mat, .npz, .parquet ...); several are taken as experiments."),
    ],
    order: Annotated[str, typer.Option(help="Number of states of the model, or auto.")] = "10",
    orders: Annotated[str, typer.Option(help="Orders that auto tests, such as 4-14 or 4,6,8; by default 1-14.")] = "",
    method: Annotated[str, typer.Option(help="pem, ssarx, pbsid, cva, n4sid or moesp.")] = "pem",
    focus: Annotated[
        str, typer.Option(help="Criterion for the model: prediction, or simulation in closed loop.")
    ] = "prediction",
    drift: Annotated[
        str,
        typer.Option(
            help="Slow drift of the outputs: auto (removed where found), none, or prefilter (always). Tones that the "
            "reference lacks are removed with it, but for none."
        ),
    ] = "auto",
    feedthrough: Annotated[
        bool, typer.Option("--feedthrough", help="Outputs respond within the sample: estimate D; else it is zero.")
    ] = False,
    first_step: Annotated[int, typer.Option(help="First step used; -1 for where the last excitation starts.")] = -1,
    steps: Annotated[int, typer.Option(help="Number of steps used; 0 for all to the end of the excitation.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for model.json, summary.json and figures; or a .json, .npz or .mat file."),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for response, orbit, bode, poles and order (PNG and HTML).", file_okay=False),
    ] = None,
    entries: EntriesOption = "",
    results: Annotated[Path | None, typer.Option(help="Write all numbers here as JSON.", dir_okay=False)] = None,
) -> None:
    """Identify the plant from the last experiment of each bag, and check the model in closed loop on the same data.

    Several bags give one model of all their experiments, each with its own initial state.
    """
    from amb_core.report.figures.entries import entries_from

    console = Terminal()
    wanted, tried = model_order(order), _orders(orders)
    if tried is not None and wanted != "auto":
        raise IdentificationError(f"--orders {orders} is not allowed with --order {order}; it is for --order auto")
    check_arguments(wanted, method, focus, drift)
    if out is not None and not names_file(out, MODEL_ENDINGS):
        figures, results, out = figures or out, results or out / "summary.json", out / "model.json"
    if out is not None:
        make_place(out, MODEL_ENDINGS)
    if results is not None:
        make_place(results)
    if figures is not None:
        make_folder(figures)
    loops = [load_recorded(console, files, path, None, first_step, steps) for path in bag]
    data, closing = _joined(bag, loops, files.resolve().controller)
    drawn = entries_from(entries, data.input_names, data.output_names)
    with Stages(console) as stages:
        result = identification.identify(
            data, wanted, method, closing, ", ".join(map(str, bag)), orders=tried, focus=cast("Focus", focus),
            drift=cast("DriftOption", drift), feedthrough=feedthrough,
            progress=lambda now: stages.update(now.stage, now.done, now.total, _cost(now)),
        )  # fmt: skip
    _warn(console, result)
    console.print(_table(result))
    if out is not None:
        result.model.save(out)
        console.print(f"model: {out}")
    if results is not None:
        write_json(results, {"inputs": inputs_of(*bag), **summary_of(result)})
        console.print(f"numbers: {results}")
    if figures is not None:
        with working(console, "drawing"):
            names = _save_figures(figures, result, drawn)
        console.print(f"{', '.join(names)}, .png and .html: {figures}")
    if out is None:
        console.print("model not saved: --out FOLDER saves the model, its numbers and figures", style="yellow")


def _warn(console: Terminal, result: Identification) -> None:
    for finding in result.report.warnings:
        where = f"{finding.where}: " if finding.where else ""
        console.print(
            Text(f"{finding.check}: {where}{finding.what}", "yellow"), f"; {finding.advice}", sep="", highlight=False
        )


def _orders(text: str) -> list[int] | None:
    if not text:
        return None
    try:
        parts = [part.split("-") for part in text.split(",")]
        orders = [order for part in parts for order in range(int(part[0]), int(part[-1]) + 1)]
    except ValueError:
        orders = []
    if not orders or min(orders) < 1:
        raise IdentificationError(f"--orders {text} is not allowed; it must be such as 4-14 or 4,6,8")
    return orders


def _joined(
    paths: list[Path], loops: list[RecordedLoop], named: str
) -> tuple[IdentificationData, KnownController | None]:
    """The experiments of all bags, and their controller; None if the data are not from the bearing's loop."""
    for path, loop in zip(paths, loops, strict=True):
        if loop.controller is None and needs_controller(loop.data) and named != NO_CONTROLLER:
            raise IdentificationError(
                f"{path} lacks the controller's parameters; name it with --controller: {ALLOWED}; or "
                f"{NO_CONTROLLER} to leave the closed loop out"
            )
    data = merge(loop.data for loop in loops)
    controllers = {path: loop.controller for path, loop in zip(paths, loops, strict=True) if loop.controller}
    for path, recorded in controllers.items():
        first, known = next(iter(controllers.items()))
        if recorded != known:
            raise IdentificationError(
                f"{first} and {path} were recorded with different controllers; identify from them one at a time"
            )
    return data, next(iter(controllers.values()), None)


def _cost(now: IdentificationProgress) -> str:
    return "" if now.cost is None else f"cost {now.cost:.6g}"


def summary_of(result: Identification) -> dict[str, Any]:
    """The result as plain JSON values in SI units; numbers that do not exist are None."""
    model, selection, uncertainty = result.model, result.order_selection, result.uncertainty
    deviations = [None] * model.order if uncertainty is None else uncertainty.pole_deviations()
    rms = np.sqrt(np.diag(model.innovation_covariance))
    content = {
        "source": model.source,
        "method": model.method,
        "order": model.order,
        "samples": model.samples,
        "sample_time": model.sample_time,
        "experiments": [
            {"source": item.source, "first_step": item.first_step, "steps": item.steps}
            for item in result.data.experiments
        ],
        "fit": dict(zip(model.output_names, model.fit, strict=False)),
        "innovation_rms": dict(zip(model.output_names, rms, strict=True)),
        "input_offset": dict(zip(model.input_names, model.input_offset, strict=True)),
        "output_offset": dict(zip(model.output_names, model.output_offset, strict=True)),
        "poles": [
            {"real": pole.real, "imaginary": pole.imag, "deviation": deviation}
            for pole, deviation in zip(model.poles(), deviations, strict=True)
        ],
        "unstable_poles": len(model.unstable_poles()),
        "feedthrough": model.d if np.any(model.d) else None,
        "poles_at_one": None if uncertainty is None else uncertainty.poles_at_one,
        "search": result.search,
        "drift": result.drift
        and {"removed": result.drift.summary, "corner": result.drift.corner, "steps": result.drift.steps},
        "tones": result.tones and {"removed": result.tones.summary, "frequencies": result.tones.frequencies},
        "verdict": result.verdict,
        "no_uncertainty_because": result.no_uncertainty_because or None,
        "not_validated_because": result.not_validated_because or None,
        "conditions": None if result.validation is None else result.validation.as_dict()["conditions"],
        "closed_loop_stable": None if result.closed_loop_poles is None else result.stable,
        "closed_loop_poles": result.closed_loop_poles,
        "order_selection": selection
        and {
            name: getattr(selection, name)
            for name in ("chosen", "orders", "bic", "aic", "validation_error", "singular_values")
        },
        "findings": [_finding(finding) for finding in result.report.findings],
    }
    return dict(plain(content))


def _finding(finding: Finding) -> dict[str, str]:
    return {
        "check": finding.check,
        "severity": finding.severity.name.lower(),
        "what": finding.what,
        "where": finding.where,
        "advice": finding.advice,
    }


def _table(result: Identification) -> Table:
    """The model and its validation; poles as continuous-time rates in 1/s, s = ln(z) / T."""
    model, selection = result.model, result.order_selection
    unstable = model.unstable_poles()
    table = Table("quantity", "value", title=f"{model.method} from {model.source}")
    counts = f"{len(model.input_names)} inputs, {len(model.output_names)} outputs"
    table.add_row("order", f"{model.order}; {counts}{', direct feedthrough' if np.any(model.d) else ''}")
    if selection is not None:
        others = f"AIC {selection.best_by_aic}, cross-validation {selection.best_by_validation}"
        end = "; the highest tried, try higher ones with --orders" if selection.at_the_end else ""
        table.add_row("order by BIC", f"{selection.chosen} of {selection.orders[0]} to {selection.orders[-1]}{end}")
        table.add_row("order by others", others)
    spans = "\n".join(f"steps {item.first_step} to {item.stop - 1}" for item in result.data.experiments)
    table.add_row("samples", f"{model.samples}, {spans}")
    _add_fits(table, model)
    table.add_row("poles z", "\n".join(_poles(result)))
    if result.uncertainty is not None and not result.uncertainty.white:
        table.add_row(
            "innovations", "not white; ± allows for that, but not for effects beyond a linear model of the order"
        )
    rates = ", ".join(f"{_number(np.log(pole) / model.sample_time, 5)} 1/s" for pole in unstable)
    table.add_row("unstable poles", f"{len(unstable)}" + (f": {rates}" if rates else ""))
    if result.uncertainty is not None and (remark := result.uncertainty.at_one):
        table.add_row(Text("pole at 1", "yellow"), remark)
    if result.no_uncertainty_because:
        table.add_row(Text("uncertainty", "yellow"), result.no_uncertainty_because)
    if result.drift is not None:
        table.add_row("drift", result.drift.summary)
    if result.tones is not None:
        table.add_row("tones", result.tones.summary)
    _add_ending(table, result)
    return table


def _add_fits(table: Table, model: StateSpaceModel) -> None:
    for name, fit in zip(model.output_names, model.fit, strict=False):
        table.add_row(f"closed-loop fit {name}", f"{fit:.2f} %")
    for name, unit, rms in zip(
        model.output_names, model.output_units, np.sqrt(np.diag(model.innovation_covariance)), strict=True
    ):
        value = f"{UNITS * rms:.4g} um" if unit == "m" else f"{rms:.4g} {unit}".strip()
        table.add_row(f"prediction error {name}", f"{value} rms")


def _add_ending(table: Table, result: Identification) -> None:
    """How the search ended, and the verdict."""
    if (search := result.search) is not None:
        done = Text("converged") if search.converged else Text("not converged", "yellow")
        left = "" if search.converged else f", {100.0 * search.left:.2g} % left"
        table.add_row("search", done + Text(f"{left}, {search.iterations} steps"))
    if result.closed_loop_poles is not None:
        table.add_row("closed loop", "stable" if result.stable else Text("unstable", "red"))
    colour = "red" if result.verdict is Verdict.NOT_VALIDATED else "yellow"
    table.add_row("verdict", Text(f"{result.verdict} on the data of the estimate", colour))
    if result.validation is None:
        table.add_row("", result.not_validated_because)
        return
    for condition in result.validation.failed:
        table.add_row("", f"{condition.name}: {condition.finding}")


def _poles(result: Identification) -> list[str]:
    """Poles with their standard deviations (the larger of real and imaginary part), where available."""
    poles = [_number(pole) for pole in result.model.poles()]
    if result.uncertainty is None:
        return poles
    deviations = result.uncertainty.pole_deviations().max(axis=1)
    return [f"{pole}  ± {deviation:.2g}" for pole, deviation in zip(poles, deviations, strict=True)]


def _number(value: complex, digits: int = 7) -> str:
    """A pole as text, without an imaginary part if it is real."""
    return f"{value.real:.{digits}g}" if value.imag == 0 else f"{value.real:.{digits}g} {value.imag:+.{digits}g}j"


def _save_figures(folder: Path, result: Identification, entries: list[Entry] | None) -> list[str]:
    """Write the figures for which there are data. Returns their names."""
    from amb_core.report import figures

    names = []
    simulated = result.data if result.tones is None else result.tones.data
    known = [index for index, item in enumerate(simulated.experiments) if item.reference is not None]
    for index in known if result.closed_loop_poles is not None else ():
        place = f"experiment_{index + 1}" if len(known) > 1 else ""
        drawn = figures.save_loop_figures(folder / place, simulated.record(index), result.simulations[index])
        names += [str(Path(place) / name) for name in drawn]
    model = result.model
    highest = 0.5 / model.sample_time
    frequencies = np.geomspace(highest / 5_000.0, 0.99 * highest, 400)
    source = response_of(model, frequencies) if result.uncertainty is None else result.uncertainty.response(frequencies)
    figures.bode_chart([source], entries=entries).save(folder, "bode")
    figures.poles_chart(result).save(folder, "poles")
    names += ["bode", "poles"]
    if result.order_selection is not None:
        selection = result.order_selection
        figures.order_chart(selection).save(folder, "order")
        names.append("order")
    return names
