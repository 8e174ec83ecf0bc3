"""`amb certify`: from a model, a controller and the data of the model to a certificate of robustness."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from amb_bringup.commands.options import declared_options
from amb_bringup.commands.own_data import DataOptions
from amb_bringup.commands.progress import working
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.validate import load_recorded
from amb_bringup.exit_codes import NOT_CERTIFIED
from amb_core.analysis import RecordedLoop
from amb_core.errors import AmbError
from amb_core.identification import StateSpaceModel, estimate_uncertainty
from amb_core.identification.controller_choice import named_controller
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.validation import validate
from amb_core.report import write_report
from amb_core.report.certificate import certificate_report
from amb_core.robustness import (
    MeasuredSensitivity,
    RobustnessSettings,
    certificate_values,
    feedback_of,
    measured_sensitivity,
    sha256_of,
)
from amb_core.robustness import certify as certificate_of


@declared_options({"Assumptions and limits": [RobustnessSettings]})
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
    description: Annotated[
        Path | None,
        typer.Option(help="Description of data files of others, as amb identify --save-description writes it."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for certificate.html and certificate.json.")] = Path(
        "results/certificate"
    ),
) -> None:
    """Certify the robustness of a model with a controller: one page with the verdict first, and certificate.json.

    Exit code 0 if the loop is certified, 4 if it is not, 1 if nothing could be computed.
    """
    console = Console(stderr=True)
    make_folder(out)
    settings = RobustnessSettings(**given)
    known = StateSpaceModel.load(model)
    law = named_controller(controller, sample_rate=1.0 / known.sample_time)
    sources = {"model": model, "bag": bag, "validation bag": validation_bag, "description": description}
    if Path(controller).exists():
        sources["controller"] = Path(controller)
    inputs = {f"{what} {path.name}": sha256_of(path) for what, path in sources.items() if path is not None}
    uncertainty = validation = measured = None
    displacement: dict[str, float] = {}
    files = DataOptions({}, description)
    if bag is not None:
        loop = load_recorded(console, files, bag, None, -1, 0)
        with working(console, "uncertainty of the model"):
            uncertainty = _uncertainty(known, loop)
        judged = loop if validation_bag is None else load_recorded(console, files, validation_bag, None, -1, 0)
        with working(console, "validating"):
            validation = validate(known, judged.data, judged.controller, uncertainty=uncertainty)
        measured = _measured(console, known, judged)
        displacement = _displacement(judged)
    with working(console, "margins, worst cases and bounds"):
        found = certificate_of(
            known, law, settings=settings, validation=validation, uncertainty=uncertainty, inputs=inputs,
            measured=measured, displacement=displacement,
        )  # fmt: skip
    write_json(out / "certificate.json", certificate_values(found))
    write_report(certificate_report(found), out / "certificate.html")
    typer.echo(found.verdict)
    console.print(f"certificate.html and certificate.json: {out}")
    if not found.certified:
        raise typer.Exit(NOT_CERTIFIED)


def _uncertainty(model: StateSpaceModel, loop: RecordedLoop) -> ModelUncertainty:
    """With the measured scatter of the innovations where they are not white."""
    found = estimate_uncertainty(model, loop.data)
    return found if found.white else estimate_uncertainty(model, loop.data, robust=True)


def _measured(console: Console, model: StateSpaceModel, loop: RecordedLoop) -> MeasuredSensitivity | None:
    """The sensitivity that the data show, under the controller of the experiment; a remark where they show none."""
    if loop.controller is None:
        return None
    try:
        return measured_sensitivity(loop.data, loop.controller, feedback_of(model, loop.controller))
    except AmbError as problem:
        console.print(f"[yellow]sensitivity not measured: {problem}[/yellow]")
        return None


def _displacement(loop: RecordedLoop) -> dict[str, float]:
    """Largest displacement over clearance, where the bag has the parameters of the plant."""
    if loop.plant is None:
        return {}
    clearance = loop.plant.rotor.backup_bearing_radius
    largest = np.max([np.abs(item.outputs).max(axis=0) for item in loop.data.experiments], axis=0)
    return {name: float(value / clearance) for name, value in zip(loop.data.output_names, largest, strict=True)}
