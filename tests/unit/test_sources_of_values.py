"""Every default of the paper's bearing is marked as stated by the paper, with the place, assumed, or against it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.graph.node_parameters import PARAMETERS
from amb_core.ground.parameters import Declaration, declarations, flatten, sourced_values
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from docs.generators.tables import parameter_table

PAPER_FILE = Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / "paper.yaml"
NEITHER = re.compile(  # of a scenario or of the computation, nothing that the paper could state about its bearing
    r"rotor\.(unbalance|external_force_.*|initial_.|axial)|iron\.bh_table|flexible_rotor\..*|sensor\.noise_seed"
    r"|integration\.internal_step|sample_rate|.*_gains"
)


def all_declarations() -> dict[str, Declaration]:
    return {
        **{item.name: item for item in declarations(PlantParameters)},
        **{f"controller.{item.name}": item for item in declarations(ControllerParameters)},
    }


@pytest.mark.parametrize("name", all_declarations())
def test_the_paper_states_a_default_or_it_is_assumed(name: str) -> None:
    item = all_declarations()[name]
    if NEITHER.fullmatch(item.name):
        assert item.source == ""
    else:
        assert re.match(r"(stated: |against )(table 1|Fig\. \d+|section \d\.\d)|assumed", item.source), item.source
    assert "assumed" not in item.description  # said once, in the source


def test_the_limits_of_currents_are_assumed() -> None:
    items = all_declarations()
    assert items["controller.current_limit"].source == "assumed"
    assert items["amplifier.current_limit"].source == "assumed"
    assert items["amplifier.supply_voltage"].source == "stated: table 1"


def test_half_of_the_mass_of_the_rotor_is_assumed() -> None:
    items = all_declarations()
    assert items["rotor.mass"].source == "assumed: half of the 12.5 kg of table 1"
    assert items["rigid_rotor.mass"].source == "stated: table 1"


def test_the_paper_limits_the_duty_cycle_only() -> None:
    assert all_declarations()["amplifier.limits"].source == "stated: section 2.4, of the duty cycle; else assumed"


def test_iron_without_saturation_and_hysteresis_is_against_the_paper() -> None:
    items = all_declarations()
    for name in ("iron.saturation", "iron.hysteresis"):
        assert items[name].default is False
        assert items[name].source == "against section 2.4, which has it, without values"


def test_the_parameter_file_marks_what_is_assumed() -> None:
    text = PAPER_FILE.read_text()
    content = yaml.safe_load(text)
    declared = all_declarations()
    given = {
        **flatten(content["/amb/simulator"]["ros__parameters"]),
        **{
            f"controller.{name}": value
            for name, value in flatten(content["/amb/pd_controller"]["ros__parameters"]).items()
        },
    }
    assert {name: declared[name].default for name in given} == given  # so their sources hold
    lines = text.splitlines()
    for name in given:
        comments = [line.partition("#")[2] for line in lines if line.strip().startswith(f"{name.split('.')[-1]}:")]
        assert any(("assumed" in comment) == ("assumed" in declared[name].source) for comment in comments), name
    assert "also the paper's" not in text


def test_another_value_than_the_default_is_neither_stated_nor_assumed() -> None:
    values = {one.name: one.source for one in sourced_values(ControllerParameters(current_limit=10.0))}
    assert values["current_limit"] == "given"
    assert values["derivative_on"] == "stated: Fig. 10"


def test_plant_describe_shows_the_sources() -> None:
    parameters = json.loads(CliRunner().invoke(app, ["plant", "describe", "--json"]).stdout)["parameters"]
    assert parameters["controller.current_limit"] == {"value": 3.0, "unit": "A", "source": "assumed"}
    assert parameters["magnetic_circuit.air_gap"]["source"] == "stated: table 1"
    assert not [name for name in parameters if name.startswith(("rigid_rotor", "thrust_bearing"))]
    changed = CliRunner().invoke(app, ["plant", "describe", "--json", "--set", "rotor.mass=8kg"]).stdout
    assert json.loads(changed)["parameters"]["rotor.mass"]["source"] == "given"


def test_tables_of_parameters_show_the_sources() -> None:
    table = parameter_table(PARAMETERS["pd_controller"])
    (line,) = [line for line in table.splitlines() if "`current_limit`" in line]
    assert line.endswith("| assumed |")
    assert "default is" not in parameter_table(PARAMETERS["recorder"])
