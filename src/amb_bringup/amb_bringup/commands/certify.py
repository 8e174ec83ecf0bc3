"""`amb certify`: from a model, a controller and the data of the model to a certificate of robustness."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from amb_bringup.commands.options import declared_options
from amb_bringup.commands.own_data import DataOptions
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import ResultError, make_folder
from amb_bringup.commands.terminal import Terminal, say
from amb_bringup.commands.validate import load_recorded
from amb_bringup.exit_codes import NOT_CERTIFIED
from amb_core.analysis import RecordedLoop
from amb_core.errors import RobustnessError
from amb_core.identification import StateSpaceModel
from amb_core.identification.controller_choice import named_controller
from amb_core.parameters import part_of
from amb_core.report.certificate import write_certificate
from amb_core.robustness import Recorded, RobustnessSettings, SweepSettings, certify_from_data, sha256_of


@declared_options({"Assumptions and limits": [RobustnessSettings], "Swept sine on the running loop": [SweepSettings]})
def certify(
    given: Mapping[str, Any],
    model: Annotated[Path, typer.Argument(help="Model, as amb identify writes it (.json, .npz or .mat).")],
    controller: Annotated[
        str,
        typer.Option(
            help="Controller to certify: paper, a ROS parameter file (.yaml), or the file of a linear controller "
            "(.json, .npz or .mat)."
        ),
    ],
    bag: Annotated[
        Path | None, typer.Option(help="Bag or data file that the model was identified from, for its uncertainty.")
    ] = None,
    validation_bag: Annotated[
        Path | None,
        typer.Option(help="Bag or data file of another experiment for the validation; by default --bag."),
    ] = None,
    sweep_bag: Annotated[
        Path | None,
        typer.Option(help="Bag of a swept sine on the running loop, as amb experiment sweep records it."),
    ] = None,
    description: Annotated[
        Path | None,
        typer.Option(help="Description of data files of others, as amb identify --save-description writes it."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for certificate.html and certificate.json.")] = Path(
        "results/certificate"
    ),
) -> None:
    """Certify the robustness of a model with a controller: one page with the verdict first, and certificate.json.

    With --sweep-amplitude the sensitivity is also measured now, by a swept sine on the graph that runs in this DDS
    domain, simulator or rig; its bag stays in --out. Exit code 0 if the loop is certified, 4 if it is not, 1 if nothing
    could be computed.
    """
    console = Terminal(stderr=True)
    make_folder(out)
    settings, sweep = part_of(RobustnessSettings, given), part_of(SweepSettings, given)
    if sweep.sweep_amplitude:
        if sweep_bag is not None:
            raise RobustnessError("--sweep-bag and --sweep-amplitude are not allowed together; give one of the two")
        sweep_bag = _measure(console, sweep, out / "sweep")
    known = StateSpaceModel.load(model)
    law = named_controller(controller, sample_rate=1.0 / known.sample_time)
    bags = {"bag": bag, "validation bag": validation_bag, "sweep bag": sweep_bag}
    sources = {"model": model, **bags, "description": description}
    if Path(controller).exists():
        sources["controller"] = Path(controller)
    inputs = {f"{what} {path.name}": sha256_of(path) for what, path in sources.items() if path is not None}
    files = DataOptions({}, description)
    used, judged, swept = (
        None if path is None else _recorded(load_recorded(console, files, path, None, -1, 0)) for path in bags.values()
    )
    with Stages(console) as stages:
        found = certify_from_data(
            known, law, used, judged, settings=settings, inputs=inputs, swept=swept, progress=stages.update
        )
    write_certificate(found, out)
    say(found.verdict)
    console.print(f"certificate.html and certificate.json: {out}")
    if not found.certified:
        raise typer.Exit(NOT_CERTIFIED)


def _measure(console: Console, sweep: SweepSettings, bag: Path) -> Path:
    """A swept sine on the graph that runs; the bag of it."""
    # They load ROS, which other certificates do not need.
    from amb_bringup.client import AmbClient
    from amb_bringup.experiment import APPEARANCE, Experiment, running_stand

    if bag.exists():
        raise ResultError(f"bag {bag}: exists already; give another folder with --out, or remove it")
    with AmbClient(nodes=()) as amb, Stages(console, "steps") as stages:
        running_stand(amb, stages.update, APPEARANCE)
        amb.experiment([Experiment("swept sine", sweep.excitation)], bag, stages.update)
    return bag


def _recorded(loop: RecordedLoop) -> Recorded:
    return Recorded(loop.data, loop.controller, loop.plant)
