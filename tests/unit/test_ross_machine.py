"""`amb plant ross`: a ROSS rotor becomes a machine that `amb up` and `amb demo` accept; wrong input is one line."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.commands.inputs import load_loop
from amb_bringup.graph.node_parameters import check_parameter_file
from amb_core.ground.errors import AmbError, PlantError
from amb_core.plant import Plant, linearize
from amb_core.plant.ross_source import ross_rotor

MATRICES = Path(__file__).parent / "data" / "ross_rotor.npz"  # see test_ross_rotor.py
ROTOR = f"""
from types import SimpleNamespace
import numpy as np

def overhung():
    kept = dict(np.load({str(MATRICES)!r}))
    shaft = SimpleNamespace(dof_mapping=lambda: {{"x_0": 0, "y_0": 1, "z_0": 2, "alpha_0": 3, "beta_0": 4}})
    bearings = [SimpleNamespace(n=node) for node in (3, 11)]
    return SimpleNamespace(**kept | {{"tag": "overhung", "nodes": kept["nodes"].tolist(), "shaft_elements": [shaft],
        "number_dof": int(kept["number_dof"]), "ndof": int(kept["ndof"]), "bearing_elements": bearings}})

def heavy():
    rotor = overhung()
    for name in ("M0", "K0", "G0"):
        setattr(rotor, name, 8.0 * getattr(rotor, name))
    return rotor

def broken():
    raise ValueError("no\\nsuch material")

def number():
    return 3
"""


@pytest.fixture
def rotor(tmp_path: Path) -> str:
    (tmp_path / "rotor.py").write_text(ROTOR)
    return str(tmp_path / "rotor.py")


def make(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["plant", "ross", *arguments])
    if isinstance(result.exception, AmbError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def holds(parameter_file: Path) -> bool:
    check_parameter_file(parameter_file)
    plant, controller = load_loop(parameter_file)
    model = linearize(Plant(plant), controller)
    return model.stable and float(np.abs(model.point.journals).max()) < 1e-7


def test_one_command_makes_a_machine_whose_rotor_is_held_at_the_centre(rotor, tmp_path):
    out = tmp_path / "made" / "overhung.yaml"
    printed = make(f"{rotor}:overhung", "--bending-modes", "2", "--out", str(out))
    assert holds(out)
    assert Plant(load_loop(out)[0]).machine.axis_names == ("x_a", "y_a", "x_b", "y_b")
    assert "bearings at nodes 3 and 11" in printed
    assert "peak sensitivity" in out.read_text().split("/amb/simulator")[0]


def test_parameters_of_a_file_are_kept_and_its_gains_replaced(rotor, tmp_path):
    base, out = tmp_path / "base.yaml", tmp_path / "machine.yaml"
    base.write_text(
        "/amb/simulator: {ros__parameters: {amplifier.bias_current: 4.0, rotor: {running_speed: 50.0}}}\n"
        "/amb/pd_controller: {ros__parameters: {derivative_filter: 1.0e-4, proportional_gains: [1.0, 1.0, 1.0, 1.0]}}\n"
    )
    make(f"{rotor}:overhung", "--bearing-nodes", "3,11", "--params", str(base), "--out", str(out))
    plant, controller = load_loop(out)
    assert plant.amplifier.bias_current == 4.0
    assert plant.rotor.running_speed == 50.0
    assert controller.derivative_filter == 1e-4
    assert controller.proportional_gains == ()
    assert holds(out)


def test_a_heavy_rotor_gets_longer_magnets(rotor, tmp_path):
    out = tmp_path / "heavy.yaml"
    printed = make(f"{rotor}:heavy", "--out", str(out))
    assert "too small for a load of" in printed
    assert load_loop(out)[0].magnetic_circuit.axial_length > 50e-3
    assert holds(out)


def test_gains_that_cannot_be_chosen_are_reported_and_the_given_ones_kept(rotor, tmp_path):
    base, out = tmp_path / "base.yaml", tmp_path / "machine.yaml"
    base.write_text("/amb/simulator: {ros__parameters: {amplifier.bias_current: 0.5}}\n")
    printed = make(f"{rotor}:overhung", "--params", str(base), "--out", str(out))
    assert "PD gains are not adapted to this rotor" in printed
    assert load_loop(out)[1].proportional_gain == 20_000.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{rotor}:overhung", "--bearing-nodes", "3,99"], "bearing_nodes has 99; allowed: nodes 0 to 14"),
        (["{rotor}:overhung", "--bearing-nodes", "3"], "--bearing-nodes 3: must be two nodes"),
        (["{rotor}:overhung", "--sensor-nodes", "a,b"], "--sensor-nodes a,b: must be two nodes"),
        (["{rotor}:overhung", "--unbalance-node", "40"], "unbalance_node has 40; allowed"),
        (["{rotor}:broken"], "ValueError: no such material"),
        (["{rotor}:number"], "the function returns a int without M0"),
        (["{rotor}:missing"], "has no function 'missing'"),
        (["{rotor}"], "needed: a file of ross.Rotor.save (.toml, .json), or a function"),
        (["none.py:make"], "none.py: cannot be read: no such file"),
        (["none.toml"], "none.toml: cannot be read: No such file"),
        (["no_such_module:make"], "there is no module 'no_such_module'"),
        (["{rotor}:overhung", "--out", "machine.txt"], "must end in .yaml"),
    ],
)
def test_wrong_input_is_one_line(rotor, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AmbError) as caught:
        make(*(argument.format(rotor=rotor) for argument in arguments))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("source", ["ross:rotor_example", "saved.toml"])
def test_without_ross_the_message_names_the_way_to_add_it(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("saved.toml").write_text("")
    monkeypatch.setitem(sys.modules, "ross", None)  # as if it were not installed
    with pytest.raises(PlantError, match="ROSS is not installed; add it with make setup EXTRAS=ross"):
        ross_rotor(source)


def test_a_rotor_with_magnetic_bearings_of_ross_becomes_a_machine(tmp_path):
    pytest.importorskip("ross")
    out = tmp_path / "amb.yaml"
    assert "bearings at nodes 12 and 43" in make("ross:rotor_amb_example", "--out", str(out))
    assert holds(out)


def test_a_saved_rotor_is_the_rotor(tmp_path):
    ross = pytest.importorskip("ross")
    path = tmp_path / "rotor.toml"
    rotor = ross.rotor_example()
    rotor.save(path)
    assert np.array_equal(ross_rotor(str(path)).M0, rotor.M0)
