"""Options made from declared parameters: one for each, with its unit, range and default in the help."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
import typer
from typer.testing import CliRunner

from amb_bringup.commands.map import region_map
from amb_bringup.commands.options import declared_options
from amb_core.excitation import KINDS
from amb_core.ground.parameters import Parameters, choice, declarations, quantity, switch
from amb_core.regions.region_map import MapSettings

SEEN: dict[str, Any] = {}


class Brake(Parameters):
    torque: float = quantity(2.0, "N m", "braking torque", 0.0, 50.0)
    pads: int = quantity(4, "-", "number of pads", 1, 8)
    lining: Literal["organic", "sintered"] = choice("organic", "what rubs")
    locked: bool = switch(False, "the wheel stands")


def amb(command: Any, *words: str) -> str:
    app = typer.Typer(rich_markup_mode=None)
    app.command()(command)
    result = CliRunner().invoke(app, list(words), catch_exceptions=False, env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


@declared_options({"Brake": [Brake]}, leave_out=["pads"], notes={"lining": "by default what is on the shelf"})
def brake(name: Annotated[str, typer.Argument()], given: dict[str, Any], out: str = "here") -> None:
    SEEN.update(name=name, given=given, out=out)


def test_a_command_gets_what_was_given_and_nothing_else() -> None:
    amb(brake, "front", "--torque", "0", "--no-locked", "--out", "there")
    assert SEEN == {"name": "front", "given": {"torque": 0.0, "locked": False}, "out": "there"}
    amb(brake, "rear")
    assert SEEN["given"] == {}


def test_the_help_shows_unit_range_and_default() -> None:
    shown = amb(brake, "--help")
    assert "Braking torque (N m), 0 to 50, by default 2." in shown
    assert "What rubs: organic or sintered, by default what is on the shelf." in shown
    assert "--locked" in shown
    assert "--pads" not in shown


def test_an_option_that_kinds_declare_differently_tells_them_apart() -> None:
    @declared_options({"Signal": KINDS.values()}, defaults={"duration": 4.0})
    def check(given: dict[str, Any]) -> None:
        SEEN.update(given=given)

    shown = amb(check, "--help")
    assert "square: fundamental frequency (Hz), 0.001 to 50000, by default 5; prbs: clock rate (Hz)" in shown
    assert "by default in_turn (sweep, square, tones), by default all (multisine, prbs, white_noise)" in shown
    amb(check, "--frequencies", "10", "--frequencies", "20")
    assert SEEN["given"] == {"duration": 4.0, "frequencies": [10.0, 20.0]}


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_of_an_excitation_is_an_option(kind: str) -> None:
    @declared_options({"Signal": [KINDS[kind]]})
    def check(given: dict[str, Any]) -> None:
        """Nothing."""

    shown = amb(check, "--help")
    for name in KINDS[kind].model_fields:
        assert f"--{name.replace('_', '-')}" in shown


def test_a_map_has_every_setting_as_an_option() -> None:
    shown = amb(region_map, "--help")
    for declared in declarations(MapSettings):
        assert f"--{declared.name.replace('_', '-')}" in shown
