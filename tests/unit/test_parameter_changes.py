"""--set NAME=VALUE changes a parameter for one call of any command that takes a parameter file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from amb_bringup.cli import LateCommand, app
from amb_bringup.commands.inputs import parameter_file
from amb_bringup.graph.node_parameters import check_parameter_file
from amb_bringup.graph.parameter_changes import changed_file
from amb_core.ground.errors import ParameterError
from amb_core.ground.files.parameter_files import ParameterFile
from amb_core.ground.parameters import load_parameters
from amb_sim_node.parameters import SimulatorParameters


def changed(folder: Path, *changes: str, base: Path | None = None) -> Path:
    out = folder / "changed.yaml"
    changed_file(base or parameter_file(None), changes, out)
    return out


def test_values_reach_the_nodes_that_they_name(tmp_path: Path) -> None:
    file = changed(
        tmp_path,
        "rotor.mass=800g",
        "controller.current_limit=2",
        "pd_controller.telemetry_block=50",
        "iron.saturation=on",
    )
    check_parameter_file(file)
    simulator = load_parameters(SimulatorParameters, file, "simulator")
    assert (simulator.rotor.mass, simulator.iron.saturation) == (0.8, True)
    assert simulator.magnetic_circuit.air_gap == 0.6e-3
    controller = ParameterFile(file).values("pd_controller")
    assert (controller["current_limit"], controller["telemetry_block"]) == (2.0, 50)
    assert controller["proportional_gain"] == 20_000.0


def test_a_change_counts_whatever_wildcards_the_file_has(tmp_path: Path) -> None:
    base = tmp_path / "wild.yaml"
    base.write_text("/amb/simulator: {ros__parameters: {rotor.mass: 5.0}}\n/**: {ros__parameters: {rotor.mass: 6.0}}\n")
    assert ParameterFile(changed(tmp_path, "rotor.mass=7", base=base)).values("simulator")["rotor.mass"] == 7.0


def test_an_empty_list_is_left_out_since_ros_cannot_read_it(tmp_path: Path) -> None:
    base = tmp_path / "held.yaml"
    base.write_text("/amb/pd_controller: {ros__parameters: {nominal_reference: [0.0, 1.0e-5]}}\n")
    file = changed(tmp_path, "controller.nominal_reference=[]", base=base)
    assert "nominal_reference" not in ParameterFile(file).values("pd_controller")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("rotor.mas=8", r"no parameter 'rotor\.mas'; did you mean rotor\.mass"),
        ("mass=8", r"no parameter 'mass'; did you mean rotor\.mass"),
        ("rotor.mass=heavy", r"'heavy' is not a number; allowed: a number in kg"),
        ("rotor.mass=-1", r"'rotor\.mass' = -1\.0 is not allowed; allowed: 0\.001 to 100000 kg"),
        ("rotor.mass=3mm", r"has the unit 'mm'; allowed: a number in kg"),
        ("iron.saturation=maybe", r"'maybe' is not a switch; allowed: true or false"),
        ("magnetic_circuit.turns_per_pole=2.5", r"'2\.5' is not a whole number"),
        ("controller.nominal_reference=1e-5", r"is not a list; allowed: a list of numbers"),
        ("rotor.model=soft", r"'rotor\.model' = 'soft' is not allowed; allowed: one of point_mass, rigid, flexible"),
        (
            "controller.sample_rate=5000",
            r"no parameter 'controller\.sample_rate'; did you mean integration\.sample_rate",
        ),
        ("rotor.mass", r"must be a name and its value"),
    ],
)
def test_what_cannot_be_set_is_refused_in_one_line(change: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=problem) as refusal:
        changed(tmp_path, change)
    assert "\n" not in str(refusal.value)


def leaves(command: Any, name: str = "amb") -> dict[str, Any]:
    command = command.load() if isinstance(command, LateCommand) else command
    parts = getattr(command, "commands", None)
    if parts is None:
        return {name: command}
    return {key: leaf for part, inner in parts.items() for key, leaf in leaves(inner, f"{name} {part}").items()}


def test_every_command_with_a_parameter_file_can_change_it() -> None:
    for name, command in leaves(get_command(app)).items():
        options = [option for item in command.params for option in item.opts]
        names = [item.name for item in command.params]
        assert ("--set" in options) == ("params" in names), name
        assert options.count("--set") <= 1, name


def test_a_command_runs_with_the_change() -> None:
    result = CliRunner().invoke(
        app, ["plant", "describe", "--json", "--set", "rotor.gravity=0"], catch_exceptions=False
    )
    assert json.loads(result.output)["constants"]["sag"]["value"] == pytest.approx(0.0, abs=1e-12)
