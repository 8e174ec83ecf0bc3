"""A wrong parameter stops its node at the start, with one line that says what is allowed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.graph.processes import NodeProcess

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.pd_controller"
GENERATOR = "amb_controller_node.excitation_generator"
IDENTIFIER = "amb_ident_node.identifier"
COMPOSED = "amb_bringup.graph.composed_loop"

WRONG_PARAMETERS = [
    (SIMULATOR, {"magnetic_circuit": {"air_gap": -1.0}}, "'magnetic_circuit.air_gap' = -1.0 is not allowed"),
    (SIMULATOR, {"magnetic_circuit": {"airgap": 1.0}}, "unknown parameter 'magnetic_circuit.airgap' = 1.0"),
    (SIMULATOR, {"rotor": {"mass": "heavy"}}, "'rotor.mass' = 'heavy' is not allowed; allowed: 0.001 to 100000 kg"),
    (SIMULATOR, {"integration": {"internal_step": 3e-7}}, "whole number of internal steps"),
    (CONTROLLER, {"derivative_on": "speed"}, "'derivative_on' = 'speed' is not allowed; allowed: one of error"),
    (CONTROLLER, {"sample_rate": 5e3}, "the machine decides it: give 'integration.sample_rate' of the simulator alone"),
    (
        CONTROLLER,
        {"derivative_gains": [38.0, -1.0]},
        "'derivative_gains' = [38.0, -1.0] is not allowed; allowed: a list",
    ),
    (CONTROLLER, {"proportional_gain": float("nan")}, "'proportional_gain' = nan is not allowed"),
    (GENERATOR, {"sample_rate": 1e4}, "unknown parameter 'sample_rate'"),
    (IDENTIFIER, {"order": 99}, "'order' = 99 is not allowed; allowed: 1 to 40"),
]


@pytest.fixture(scope="module")
def refused(open_graph: Any, tmp_path_factory: Any) -> Iterator[list[NodeProcess]]:
    """The processes that are started with these parameters, all at once."""
    with open_graph(tmp_path_factory.mktemp("refused")) as graph:
        processes = [graph.start(module, parameters=parameters) for module, parameters, _ in WRONG_PARAMETERS]
        yield processes
        for process in processes:  # those too that only tests of another worker wait for
            process.wait_for_end(TIMEOUT)


@pytest.mark.parametrize("number", range(len(WRONG_PARAMETERS)), ids=[line for _, _, line in WRONG_PARAMETERS])
def test_wrong_parameter_stops_the_node_at_start_with_one_line(refused, number):
    refused[number].wait_for_end(TIMEOUT)
    assert refused[number].returncode == 1
    errors = refused[number].said
    assert WRONG_PARAMETERS[number][2] in errors
    assert len(errors.strip().splitlines()) == 1
