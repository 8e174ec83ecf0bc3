"""`amb demo` as a user types it, up to where the graph starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_bringup.client.experiment import settling_steps
from amb_bringup.commands.demo import demo
from amb_bringup.demos.demo import SMALL_STEP, SQUARES, fitting
from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.ground.parameters import validate
from amb_core.plant import PlantParameters


@pytest.mark.parametrize("content", [None, "/amb/simulator: {ros__parameters: {rotor.mas: 5.0}}\n"])
def test_a_wrong_parameter_file_leaves_the_results_of_an_earlier_demo(content: str | None, tmp_path: Path) -> None:
    kept = tmp_path / "out" / "model.json"
    kept.parent.mkdir()
    kept.write_text("{}")
    parameters = tmp_path / "my_bearing.yaml"
    if content is not None:
        parameters.write_text(content)
    with pytest.raises(ParameterError, match=r"my_bearing|rotor.mas"):
        demo(out=kept.parent, params=parameters)
    assert kept.read_text() == "{}"


@pytest.mark.parametrize("actuators", ["differential", "top_coil"])
def test_magnets_that_pull_along_one_axis_are_refused_before_anything_starts(actuators: str, tmp_path: Path) -> None:
    parameters = tmp_path / "my_bearing.yaml"
    parameters.write_text(
        f"/amb/simulator: {{ros__parameters: {{magnetic_circuit: {{actuators: {actuators}, coupling: false}}}}}}\n"
    )
    with pytest.raises(ExcitationError, match=f"actuators = '{actuators}' is not allowed: the demo shakes x and y"):
        demo(out=tmp_path / "out", params=parameters)
    assert not (tmp_path / "out").exists()


def test_a_bearing_with_less_clearance_than_the_papers_is_shaken_less() -> None:
    paper = PlantParameters()
    assert (fitting(SQUARES, paper), fitting(SMALL_STEP, paper)) == (SQUARES, SMALL_STEP)
    wide = validate(PlantParameters, {"rotor.backup_bearing_radius": 2.0 * paper.rotor.backup_bearing_radius})
    assert fitting(SQUARES, wide) == SQUARES
    narrow = validate(PlantParameters, {"rotor.backup_bearing_radius": 0.5 * paper.rotor.backup_bearing_radius})
    assert fitting(SQUARES, narrow).amplitude == 0.5 * SQUARES.amplitude


@pytest.mark.parametrize(("rate", "steps"), [(1e3, 2_000), (1e4, 2_000), (2e4, 4_000), (1e5, 20_000)])
def test_the_rotor_has_a_fifth_of_a_second_to_settle_at_any_sample_rate(rate: float, steps: int) -> None:
    assert settling_steps(rate) == steps
