"""`amb certify`: from a model, a controller and the data of the model to a certificate of robustness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from amb_bringup.commands.options import declared_options
from amb_bringup.commands.own_data import read_shown
from amb_bringup.commands.progress import Stages
from amb_bringup.commands.results import ResultError, make_folder
from amb_bringup.commands.terminal import Terminal, say
from amb_bringup.exit_codes import NOT_CERTIFIED, NOT_THE_SAME
from amb_core.ground.errors import RobustnessError
from amb_core.ground.parameters import part_of
from amb_core.robustness import RobustnessSettings, SweepSettings
from amb_core.robustness.trace import CertificateHeader


@declared_options({
    "Assumptions and limits": [RobustnessSettings],
    "Swept sine on the running loop": [SweepSettings],
    "Machine and signature": [CertificateHeader],
})  # fmt: skip
def certify(
    given: Mapping[str, Any],
    model: Annotated[
        Path | None, typer.Argument(help="Model, as amb identify writes it (.json, .npz or .mat).", show_default=False)
    ] = None,
    controller: Annotated[
        str,
        typer.Option(
            help="Controller to certify: paper, pd:K_P,K_D in A/m and A s/m with the derivative on the position error, "
            "pd:K_P,K_D,measurement with that on the measured position, a ROS parameter file (.yaml), or the file of a "
            "linear controller (.json, .npz or .mat); by default that of the experiment."
        ),
    ] = "",
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
    again: Annotated[
        Path | None,
        typer.Option(
            help="certificate.json that is computed again from its files, and compared; files that have moved are "
            "given as usual.",
            dir_okay=False,
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for certificate.html and certificate.json.")] = Path(
        "results/certificate"
    ),
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also certificate.pdf, to be signed, by the browser that is installed.")
    ] = False,
) -> None:
    """Certify the robustness of a model with a controller: one page with the verdict first, and certificate.json.

    With --sweep-amplitude the sensitivity is also measured now, by a swept sine on the graph that runs in this DDS
    domain, simulator or rig; its bag stays in --out. Exit code 0 if the loop is certified, with or without
    reservations, 4 if it is not, 1 if nothing could be computed. With --again a certificate is computed again, and
    nothing written: exit code 0 for the same numbers, 5 if a file, a number or a verdict differs.
    """
    from amb_core.report.pages.certificate import write_certificate
    from amb_core.report.pages.certification import Request, certify_request, require_request
    from amb_core.report.pages.pdf import find_browser, write_pdf

    console = Terminal(stderr=True)
    files = {
        name: "" if path is None else str(path)
        for name, path in (
            ("model", model), ("bag", bag), ("validation_bag", validation_bag), ("sweep_bag", sweep_bag),
            ("description", description),
        )
    }  # fmt: skip
    if again is not None:
        if given or controller or pdf:
            raise RobustnessError("--again takes settings and controller from the certificate; leave out other options")
        _again(console, again, files)
        return
    if model is None:
        raise RobustnessError("no model is given; name the file that amb identify has written")
    settings, sweep = part_of(RobustnessSettings, given), part_of(SweepSettings, given)
    request = Request(**files, controller=controller, settings=settings, header=part_of(CertificateHeader, given))
    if not controller and bag is None and validation_bag is None:
        raise RobustnessError("no controller is given; name one with --controller, or the bag of its experiment")
    if sweep.sweep_amplitude and sweep_bag is not None:
        raise RobustnessError("--sweep-bag and --sweep-amplitude are not allowed together; give one of the two")
    require_request(request)
    browser = find_browser() if pdf else None
    make_folder(out)
    if sweep.sweep_amplitude:
        request = replace(request, sweep_bag=str(_measure(console, sweep, out / "sweep")))
    with Stages(console) as stages:
        certificate = certify_request(request, reader=read_shown(console), progress=stages.update)
    page = write_certificate(certificate, out)
    say(certificate.verdict)
    console.print(f"certificate.html and certificate.json: {out}")
    if browser:
        console.print(f"PDF, to be signed: {write_pdf(page, browser)}")
    if not certificate.certified:
        raise typer.Exit(NOT_CERTIFIED)


def _again(console: Console, path: Path, files: Mapping[str, str]) -> None:
    """Compute a certificate again and report what differs."""
    from amb_core.report.pages.again import certify_again

    with Stages(console) as stages:
        repetition = certify_again(path, files, stages.update)
    for text in repetition.differences:
        say(f"differs: {text}")
    for text in repetition.remarks:
        console.print(text, style="yellow", highlight=False, soft_wrap=True)
    if repetition.differences:
        raise typer.Exit(NOT_THE_SAME)
    say(f"The same certificate: {repetition.compared} values agree. {repetition.certificate.verdict}")


def _measure(console: Console, sweep: SweepSettings, bag: Path) -> Path:
    """A swept sine with dwells on the graph that runs; the bag of it."""
    # They load ROS, which other certificates do not need.
    from amb_bringup.client import AmbClient
    from amb_bringup.client.experiment import APPEARANCE, running_stand
    from amb_bringup.client.swept_sensitivity import measure_swept

    if bag.exists():
        raise ResultError(f"bag {bag}: exists already; give another folder with --out, or remove it")
    with AmbClient(nodes=()) as amb, Stages(console, "steps") as stages:
        running_stand(amb, stages.update, APPEARANCE)
        measure_swept(amb, sweep, bag, "", stages.update)
    return bag
