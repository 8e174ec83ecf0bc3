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
    (
        CONTROLLER,
        {"colour": 1},
        "unknown parameter 'colour' = 1; known: proportional_gain, derivative_gain, derivative_fi",
    ),
    (CONTROLLER, {"proportional_gain": True}, "'proportional_gain' = True is not allowed; allowed: 0 to 1e+06 A/m"),
    (CONTROLLER, {"proportional_gain": "21000"}, "'proportional_gain' = '21000' is not allowed; allowed: 0 to 1e+06"),
    (SIMULATOR, {"autostart": 1}, "'autostart' = 1 is not allowed; allowed: true or false"),
    (SIMULATOR, {"plant_state_steps": 1.0}, "'plant_state_steps' = 1.0 is not allowed; allowed: whole numbers, 0 to"),
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


def test_an_unknown_parameter_is_not_answered_with_one_that_is_refused(refused):
    asked = [parameters for _, parameters, _ in WRONG_PARAMETERS].index({"colour": 1})
    refused[asked].wait_for_end(TIMEOUT)
    assert "sample_rate" not in refused[asked].said


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--params-file", "/nowhere.yaml"], "Couldn't parse params file: '--params-file /nowhere.yaml'"),
        (["-r", "__ns:=left"], "Couldn't parse remap rule: '-r __ns:=left'"),
        (["-p", "proportional_gain"], "Couldn't parse parameter override rule: '-p proportional_gain'"),
        (["--colour"], "unknown arguments after --ros-args: ['--colour']"),
    ],
    ids=str,
)
def test_arguments_that_ros_cannot_use_stop_the_node_with_one_line(graph, arguments, line):
    ended_with(graph.start(CONTROLLER, *arguments), line)


@pytest.mark.parametrize("named", ["300", "abc"])
def test_what_is_no_domain_stops_the_node_with_one_line(graph, named):
    graph.environment["ROS_DOMAIN_ID"] = named
    ended_with(graph.start(CONTROLLER), f"ROS_DOMAIN_ID = '{named}' is not allowed; allowed: 0 to 232")


def ended_with(process: NodeProcess, line: str) -> None:
    """Assert that a node ends and says so in one line of its own; rcl has one, too."""
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 1
    (own,) = [said for said in process.said.splitlines() if "[rcl]" not in said]
    assert own.startswith(f"[amb] {line}")
