"""Which machine the node `target_emulator` emulates."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_core.ground.errors import ParameterError
from amb_sim_node.gains import gains_in
from amb_sim_node.machine_files import machine_file, machine_parameters

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"


@pytest.fixture
def of_launch(tmp_path: Path) -> str:
    """What `ros2 launch` makes of parameters in a launch file."""
    path = tmp_path / "launch_params"
    path.write_text("/**:\n  ros__parameters:\n    port: 0\n")
    return str(path)


def test_the_last_file_with_a_plant_is_that_of_the_machine(of_launch: str) -> None:
    rig, thrust = str(CONFIG / "rig.yaml"), str(CONFIG / "thrust.yaml")
    arguments = ["emulator", "--ros-args", "--params-file", thrust, "--params-file", rig, "--params-file", of_launch]
    assert machine_file("", arguments, "/amb") == rig
    assert machine_file(thrust, arguments, "/amb") == thrust
    assert machine_file("", ["emulator", "--ros-args", "--params-file", of_launch], "/amb") == ""


def test_a_graph_in_another_namespace_has_its_own_blocks(tmp_path: Path) -> None:
    path = tmp_path / "left.yaml"
    path.write_text(
        "/left/simulator: {ros__parameters: {rotor.mass: 5.0}}\n"
        "/left/pd_controller: {ros__parameters: {proportional_gain: 21000.0}}\n"
    )
    arguments = ["bridge", "--ros-args", "--params-file", str(path)]
    assert machine_file("", arguments, "/left") == str(path)
    assert gains_in(arguments, "/left") == {"proportional_gain": 21_000.0}
    with pytest.raises(ParameterError, match="'/left/simulator' names no node"):
        machine_file("", arguments, "/right")


def test_plant_and_gains_are_those_of_simulator_and_controller() -> None:
    plant, controller = machine_parameters(str(CONFIG / "thrust.yaml"), "/amb")
    assert plant.rotor.axial
    assert controller.derivative_gains == (38.0, 38.0, 38.0, 38.0, 80.0)


def test_without_a_file_it_is_the_paper_bearing() -> None:
    plant, controller = machine_parameters("", "/amb")
    assert (plant.rotor.model, controller.proportional_gain) == ("point_mass", 20_000.0)


def test_a_misspelt_parameter_of_the_plant_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("/amb/simulator: {ros__parameters: {rotor: {gravety: 0.0}}}\n")
    with pytest.raises(ParameterError, match=r"wrong\.yaml, node /amb/simulator: .*did you mean 'rotor\.gravity'"):
        machine_parameters(str(path), "/amb")
