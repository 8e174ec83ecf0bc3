"""`amb commission`: leads through the first levitation of a rig, and writes a protocol."""

from __future__ import annotations

import hashlib
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from amb_bringup.commands.inputs import parameter_file
from amb_bringup.commands.options import ParamsOption, declared_options
from amb_bringup.commands.results import make_folder, write_json
from amb_bringup.commands.terminal import Terminal
from amb_bringup.exit_codes import CHECK_FAILED
from amb_bringup.graph.launcher import own_domain
from amb_bringup.graph.node_parameters import check_parameter_file, require_emulated_target
from amb_core.ground.files.parameter_files import BRIDGE_NODE, NAMESPACE, RIG_NODES, ParameterFile
from amb_core.ground.parameters import part_of, validate
from amb_core.ground.version import __version__
from amb_core.loop.control import ControllerParameters
from amb_core.recording import Recording
from amb_core.regions.region_map import RegionMap
from amb_core.rig.commissioning import CommissioningSettings, Expected, Step, expected_of
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.gains import gains_in
from amb_sim_node.machine_files import machine_parameters

if TYPE_CHECKING:
    from amb_bringup.experiments.commissioning import Session

FILES = ("protocol.html", "protocol.json", "report.html", "model.json")


@declared_options({"Excitations and limits": [CommissioningSettings]})
def commission(
    given: dict[str, Any],
    params: ParamsOption = None,
    emulator: Annotated[
        bool, typer.Option("--emulator", help="Commission an emulated target on this machine.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for protocol, bag, model and report.")] = Path("results/commission"),
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Region map with which the excitations are compared.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask before the rotor is moved.")] = False,
    wiring: Annotated[
        bool, typer.Option(help="Check sensors and coils before the first lift-off, with small currents.")
    ] = True,
    report: Annotated[bool, typer.Option(help="Also write the report on the recording.")] = True,
) -> None:
    """Commission a rig: check sensors, coils, link, levitation, polarity, resonance, plant and protection.

    Starts the nodes of the rig with the parameter file, so `amb rig up` must not run. Asks before the rotor is moved.
    After a step that fails, and after Ctrl-C, the rotor is landed. Results of an earlier session in the folder are
    replaced. Exit code 0 if no step failed, 3 if one did. See docs/how-to/commission-a-rig.md.
    """
    from amb_bringup.experiments.commissioning import Session
    from amb_bringup.graph.own_graph import own_graph
    from amb_core.report.pages import write_report
    from amb_core.report.pages.recording import recording_report

    console = Terminal()
    path = parameter_file(params).absolute()
    check_parameter_file(path)
    if emulator:
        require_emulated_target(path)
    settings = validate(CommissioningSettings, given)
    bridge = _bridge(path)
    expected = _expected(path, bridge)
    region_map = RegionMap.load(map_file) if map_file is not None else None
    domain = own_domain()
    make_folder(out)
    arguments = {"params": str(path), "emulator": str(emulator).lower()}
    with own_graph("rig", arguments, domain, RIG_NODES) as (graph, amb):
        _clear(out)
        confirm = None if yes else _confirm
        session = Session(
            amb, settings, bridge, expected, region_map, confirm, graph.check, lambda step: _show(console, step), wiring
        )
        session.protocol.about = _about(path, emulator, expected)
        try:
            session.carry_out(out / "bag")
        finally:
            _write(session, out)
    if report and (out / "bag").exists() and not session.protocol.failed:
        write_report(recording_report(Recording.read(out / "bag"), None, session.order), out / "report.html")
    console.print(f"protocol.html, protocol.json, figures, bag: {out}")
    if session.protocol.failed:
        raise typer.Exit(CHECK_FAILED)


def _clear(out: Path) -> None:
    """Remove the results of an earlier session, and nothing else."""
    for folder in ("bag", "figures"):
        shutil.rmtree(out / folder, ignore_errors=True)
    for name in FILES:
        (out / name).unlink(missing_ok=True)


def _confirm(question: str) -> bool:
    try:
        return typer.confirm(question)
    except typer.Abort:
        raise KeyboardInterrupt from None


def _bridge(path: Path) -> BridgeParameters:
    """The parameters with which the bridge starts: gains that it is not given are those of pd_controller."""
    values = gains_in(["--params-file", str(path)], NAMESPACE) | ParameterFile(path).values(BRIDGE_NODE)
    return validate(BridgeParameters, values)


def _expected(path: Path, bridge: BridgeParameters) -> Expected | None:
    """What the model of a file predicts of its machine; None if it describes none, or another law closes the loop."""
    if bridge.controller_file or not ParameterFile(path).values("simulator"):
        return None
    plant, _ = machine_parameters(str(path), NAMESPACE)
    return expected_of(plant, part_of(ControllerParameters, bridge.model_dump()))


def _about(path: Path, emulator: bool, expected: Expected | None) -> dict[str, str]:
    return {
        "date": datetime.now(UTC).astimezone().isoformat(timespec="seconds"),
        "parameter file": str(path),
        "SHA-256 of it": hashlib.sha256(path.read_bytes()).hexdigest(),
        "compared with": "its model of the machine" if expected is not None else "general limits: it has no model",
        "target": "emulated on this machine" if emulator else "that of hardware_bridge.link",
        "amb_core": __version__,
    }


def _show(console: Console, step: Step) -> None:
    """A step when it begins, and its checks when it has ended."""
    if not step.began and not step.skipped:
        console.rule(step.title, align="left")
        return
    for line in [step.reason] if step.reason else []:
        console.print(line, highlight=False, markup=False)
    if step.checks:
        table = Table("check", "value", "limit", "result")
        for check in step.checks:
            table.add_row(
                check.what, check.shown, check.limit, {True: "passed", False: "failed", None: ""}[check.passed]
            )
        console.print(table)
    for check in step.checks:
        if check.passed is False and check.advice:
            console.print(f"{check.what}: {check.advice}", highlight=False, markup=False)
    colour = {"passed": "green", "failed": "red", "skipped": "yellow"}[step.result]
    console.print(f"{step.name}: ", Text(step.result, colour), sep="")


def _write(session: Session, out: Path) -> None:
    from amb_core.report.figures.saving import write_image
    from amb_core.report.pages import write_report
    from amb_core.report.pages.commissioning import protocol_report

    write_json(out / "protocol.json", session.protocol.to_json())
    write_report(protocol_report(session.protocol, session.figures.values()), out / "protocol.html")
    for name, chart in session.figures.items():
        write_image(out / "figures", name, chart.figure(), chart.title, chart.alt)
    if session.model is not None:
        session.model.save(out / "model.json")
