"""What commands are given: a parameter file is read as the nodes read it."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_bringup.commands.inputs import load_loop, load_regions
from amb_core.ground.errors import ParameterError


def written(path: Path, node: str, parameters: str) -> Path:
    file = path / "my_bearing.yaml"
    file.write_text(f"/amb/{node}: {{ros__parameters: {{{parameters}}}}}\n")
    return file


@pytest.mark.parametrize(
    ("node", "parameters"),
    [("simulator", "rotor.mas: 5.0"), ("pd_controller", "proportional_gian: 1.0"), ("region_monitor", "drift: 1.0e-6")],
)
def test_misspelt_parameters_are_refused_not_left_out(node: str, parameters: str, tmp_path: Path) -> None:
    file = written(tmp_path, node, parameters)
    with pytest.raises(ParameterError, match=rf"node {node}: unknown parameter"):
        load_regions(file) if node == "region_monitor" else load_loop(file)


def test_parameters_of_the_nodes_themselves_are_left_to_them(tmp_path: Path) -> None:
    plant, _ = load_loop(written(tmp_path, "simulator", "plant_state_steps: 10, rotor.mass: 5.0"))
    assert plant.rotor.mass == 5.0
