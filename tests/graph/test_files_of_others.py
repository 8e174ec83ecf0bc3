"""The identifier and `AmbClient` read every file that `amb identify` reads, by the same description."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from amb_bringup.client import AmbClient
from amb_core.data.analysis import read
from amb_core.data.experiments import DataDescription
from amb_core.ground.errors import AmbError
from tests.benchmarks.first_hour.files import CASES, FOLDER, TOLERANCE, Case, pole_error
from tests.graph.identifier_loop import Loop

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

WHOLE = {case.file: case for case in CASES if not case.helps}
"""One case for each file that can be identified."""
REFUSED = {case.file: case for case in CASES if case.helps}


def identifier(graph: Graph) -> AmbClient:
    Loop(graph)
    return AmbClient(domain_id=int(graph.environment["ROS_DOMAIN_ID"]), nodes=("identifier",))


@pytest.fixture
def client(share: Callable[..., Any]) -> AmbClient:
    return share(identifier)


def described(case: Case) -> DataDescription:
    """The options of a case as a description."""
    names = [name.removeprefix("--").replace("-", "_") for name in case.options[::2]]
    return DataDescription.of().with_values(**dict(zip(names, case.options[1::2], strict=True)))


@pytest.mark.parametrize("case", WHOLE.values(), ids=lambda case: case.file)
def test_the_service_reads_what_the_command_reads(client: AmbClient, case: Case) -> None:
    model = client.identify(FOLDER / case.file, order=2 * case.axes, description=described(case))
    data = read(FOLDER / case.file, described(case)).data
    assert pole_error(model) < TOLERANCE
    assert model.samples == data.samples
    assert (model.input_names, model.output_units) == (data.input_names, data.output_units)


@pytest.mark.parametrize("case", REFUSED.values(), ids=lambda case: case.file)
def test_the_service_refuses_what_the_command_refuses(client: AmbClient, case: Case) -> None:
    with pytest.raises(AmbError) as refusal:
        client.identify(FOLDER / case.file, order=2 * case.axes, description=described(case))
    named = "controller" if case.helps == "--controller" else case.helps
    assert named in str(refusal.value)


def test_a_saved_description_is_read_by_validate_too(client: AmbClient, tmp_path: Path) -> None:
    case = WHOLE["spaces.dat"]
    described(case).save(tmp_path / "rig.yaml")
    client.identify(FOLDER / case.file, order=2, description=tmp_path / "rig.yaml")
    answer = client.validate(FOLDER / case.file, description=tmp_path / "rig.yaml")
    assert answer.one_step_fit[0] > 99.0
    with pytest.raises(AmbError, match="description is for a bag or data file"):
        client.identify(description=tmp_path / "rig.yaml")


@pytest.mark.parametrize(
    ("description", "reason"),
    [
        ("inputs: [", "description in the request: is damaged"),
        ("- u", "must have lines such as inputs"),
        ("inputs: [{a: b}]", "inputs must be a list of names"),
        ("signals: [u]", "'signals' is not allowed; allowed: inputs, outputs"),
        ("/nowhere/rig.yaml", "description /nowhere/rig.yaml: cannot be read"),
        ("[" * 20_000, "description in the request: is damaged"),
    ],
)
def test_a_description_that_is_none_is_refused_in_one_line(client: AmbClient, description: str, reason: str) -> None:
    with pytest.raises(AmbError, match=reason) as refusal:
        client.identify(FOLDER / "mil.csv", order=2, description=description)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 3_000
