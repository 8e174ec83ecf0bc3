"""`amb plant ross`: a machine, as modal data and parameter file, from a rotor modelled in ROSS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import yaml

from amb_bringup.commands.options import ParamsOption
from amb_bringup.commands.results import ResultError, make_place
from amb_bringup.commands.terminal import say
from amb_controller_node.parameters import PdControllerParameters
from amb_core.designs.tuning.pd_gains import choose_gains
from amb_core.ground.errors import PlantError
from amb_core.ground.files.parameter_files import PARAMETERS, ParameterFile, full_name
from amb_core.ground.parameters import load_parameters, nest, part_of, validate
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, modal_data_from_ross
from amb_core.plant.closed_forms import current_gain
from amb_core.plant.modal_data import ModalData
from amb_core.plant.ross_source import ross_rotor
from amb_sim_node.parameters import SimulatorParameters

CHOSEN = ("proportional_gain", "derivative_gain", "nominal_reference")
CARRYING = 1.0 / 3.0  # share of the bias current that carries the rotor, as in the paper's rig


def ross(
    rotor: Annotated[
        str,
        typer.Argument(
            help="File of ross.Rotor.save (.toml, .json), or a function that makes the rotor: MODULE:FUNCTION or "
            "FILE.py:FUNCTION.",
        ),
    ],
    bearing_nodes: Annotated[
        str | None,
        typer.Option(
            help="Nodes in bearings A and B, as 4,22; by default those of the rotor's own bearings, if there are two."
        ),
    ] = None,
    sensor_nodes: Annotated[
        str | None, typer.Option(help="Nodes at the sensors of A and B; by default those in the bearings.")
    ] = None,
    unbalance_node: Annotated[
        int | None, typer.Option(help="Node of the unbalance; by default the one nearest to the centre of mass.")
    ] = None,
    bending_modes: Annotated[int, typer.Option(help="Bending modes in each plane.", min=0)] = 3,
    damping_ratio: Annotated[float, typer.Option(help="Damping ratio of the bending modes.", min=0.0, max=1.0)] = 0.005,
    params: ParamsOption = None,
    out: Annotated[
        Path, typer.Option(help="Parameter file to write, .yaml; the modal data get its name with .npz.")
    ] = Path("results/ross.yaml"),
) -> None:
    """Make a machine from a ROSS rotor: modal data, and a parameter file with PD gains that hold it.

    Bearings, amplifiers and running speed are those of --params. Without it they are the paper's, with longer magnets
    if the rotor is too heavy for them. The gains are chosen for the linearised machine.
    """
    make_place(out, (".yaml", ".yml"))
    model = ross_rotor(rotor)
    nodes = _own_nodes(model) if bearing_nodes is None else _two("--bearing-nodes", bearing_nodes)
    data = modal_data_from_ross(
        model,
        nodes,
        None if sensor_nodes is None else _two("--sensor-nodes", sensor_nodes),
        unbalance_node,
        bending_modes,
        damping_ratio,
    )
    modes = out.with_suffix(".npz").absolute()
    data.save(modes)
    simulator, controller = _given(params)
    remarks = [
        f"{data.description}.",
        f"Bending modes: {', '.join(f'{value:.4g} Hz' for value in data.natural_frequencies[4::2]) or 'none'}.",
        *(_longer_magnets(simulator, data) if params is None else ()),
        _gains(simulator, controller, modes),
    ]
    _write(out, rotor, simulator, controller, remarks)
    for remark in remarks:
        say(remark)
    typer.echo(f"written to {out} and {modes.name}; next: amb demo --params {out}")


def _two(option: str, text: str) -> tuple[int, int]:
    try:
        first, second = (int(word) for word in text.split(","))
    except ValueError:
        raise PlantError(f"{option} {text}: must be two nodes, at A and at B, as 4,22") from None
    return first, second


def _own_nodes(rotor: Any) -> tuple[int, int]:
    elements = getattr(rotor, "bearing_elements", [])  # in ROSS seals are bearings, too
    nodes = sorted({int(element.n) for element in elements if "Seal" not in type(element).__name__})
    if len(nodes) != 2:
        raise PlantError(
            f"ROSS rotor '{rotor.tag}' has bearings at {len(nodes)} nodes; give the two of the machine: "
            "--bearing-nodes 4,22"
        )
    return nodes[0], nodes[1]


def _given(params: Path | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of simulator and controller in a file, by dotted name; none without a file."""
    if params is None:
        return {}, {}
    load_parameters(SimulatorParameters, params, "simulator")  # refuses what the nodes would refuse
    load_parameters(PdControllerParameters, params, "pd_controller")
    file = ParameterFile(params)
    simulator = {name: value for name, value in file.values("simulator").items() if not name.startswith("rigid_rotor.")}
    return simulator, file.values("pd_controller")


def _longer_magnets(simulator: dict[str, Any], data: ModalData) -> list[str]:
    """Lengthen the paper's magnets until a third of the bias current carries the rotor; a remark if that was needed."""
    plant = validate(SimulatorParameters, simulator)
    circuit, bias = plant.magnetic_circuit, plant.amplifier.bias_current
    load = float(np.abs(data.static_loads(plant.rotor.gravity)).max())
    longer = load / (CARRYING * bias * current_gain(circuit, bias))
    if longer <= 1.0:
        return []
    length = float(f"{longer * circuit.axial_length:.3g}")
    simulator["magnetic_circuit.axial_length"] = length
    return [
        f"The paper's bearings are too small for a load of {load:.4g} N: magnets {1e3 * length:.4g} mm long instead of "
        f"{1e3 * circuit.axial_length:.4g} mm."
    ]


def _gains(simulator: dict[str, Any], controller: dict[str, Any], modes: Path) -> str:
    """Add rotor and gains to the parameters; returns a remark about the gains."""
    simulator |= {"rotor.model": "flexible", "flexible_rotor.modal_data": str(modes)}
    simulator.setdefault("backup_bearing.contact", True)
    plant = Plant(validate(SimulatorParameters, simulator))
    given = part_of(ControllerParameters, controller).at_rate(plant.machine.sample_rate)
    for name in (name for name in ControllerParameters.model_fields if name.endswith("_gains")):
        controller.pop(name, None)  # those of single axes
    try:
        chosen = choose_gains(plant, given)
    except PlantError as problem:
        controller |= {name: getattr(given, name) for name in CHOSEN[:2]}
        return f"PD gains are not adapted to this rotor: {problem}."
    controller |= {name: getattr(chosen.controller, name) for name in CHOSEN}
    controller["nominal_reference"] = list(chosen.controller.nominal_reference)
    return (
        f"K_P = {chosen.controller.proportional_gain:g} A/m and K_D = {chosen.controller.derivative_gain:g} A s/m hold "
        f"the linearised machine with a peak sensitivity of {chosen.peak_sensitivity:.3g}."
    )


def _write(out: Path, source: str, simulator: dict[str, Any], controller: dict[str, Any], remarks: list[str]) -> None:
    sections = {
        full_name(node): {PARAMETERS: nest(values)}
        for node, values in (("simulator", simulator), ("pd_controller", controller))
    }
    comments = [
        f"Made by amb plant ross from {source}.",
        *remarks,
        "The file of modes is named by its whole path: change it if you move the files.",
    ]
    text = "".join(f"# {' '.join(line.split())}\n" for line in comments)
    text += yaml.safe_dump(sections, sort_keys=False, allow_unicode=True, width=120)
    try:
        out.write_text(text)
    except OSError as problem:
        raise ResultError(f"{out}: cannot be written: {problem.strerror}") from None
