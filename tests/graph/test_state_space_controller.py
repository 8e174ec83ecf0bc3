"""Node state_space_controller in the place of pd_controller: samples of the loop without ROS, and what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from amb_core.excitation import Square, generate
from amb_core.ground.errors import ParameterError
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.linear_control import LinearController, LinearControllerParameters, pd_as_linear
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate
from amb_core.recording.messages.state_space_model import fill_model
from amb_msgs.msg import StateSpaceModel as StateSpaceModelMessage
from amb_ros.qos import LATCHED
from tests.graph.bearing import Bearing
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.state_space_controller"
GENERATOR = "amb_controller_node.excitation_generator"
STEPS, EXCITED_FROM = 1_050, 200
SQUARE = Square(amplitude=20e-6, duration=0.08, frequency=50.0)
FILTERED = ControllerParameters(derivative_filter=1e-4)


def test_samples_are_those_of_the_loop_without_ros(graph: Graph, tmp_path: Path) -> None:
    model = pd_as_linear(FILTERED)
    model.save(tmp_path / "controller.json")
    graph.start(SIMULATOR)
    graph.start(CONTROLLER, parameters={"controller_file": str(tmp_path / "controller.json")})
    graph.start(GENERATOR)
    bearing = Bearing(graph)
    run = bearing.reset()
    graph.wait_until(bearing.telemetry.get_publisher_count, "the controller")
    bearing.excite(SQUARE, run, EXCITED_FROM)
    bearing.run(STEPS)
    law = LinearController(model, LinearControllerParameters(), 2, 10_000.0)
    expected = simulate(Plant(), law, STEPS, generate(SQUARE, 10_000.0).samples, EXCITED_FROM)
    assert bearing.record(run, STEPS).identical_to(expected)


def test_a_controller_may_come_on_a_topic_and_replaces_one_that_does_not_fit(graph: Graph, tmp_path: Path) -> None:
    pd_as_linear(FILTERED, axes=4).save(tmp_path / "controller.json")
    graph.start(SIMULATOR)
    graph.start(CONTROLLER, parameters={"controller_file": str(tmp_path / "controller.json")})
    bearing = Bearing(graph)
    run = bearing.reset()
    bearing.run(300)
    graph.wait_until(
        lambda: any(
            status.level == DiagnosticStatus.ERROR and "8 inputs and 4 outputs, the machine 2 axes" in status.message
            for status in bearing.diagnostics
        ),
        "the reason why nothing is answered",
    )
    publisher = graph.node.create_publisher(StateSpaceModelMessage, "/amb/controller", LATCHED)
    publisher.publish(fill_model(StateSpaceModelMessage(), pd_as_linear(FILTERED)))
    assert bearing.record(run, 300).steps == 300


@pytest.mark.parametrize(
    ("name", "reason"), [("missing.json", "cannot be read"), ("empty.json", "controller_file: "), ("model.txt", "")]
)
def test_a_file_that_holds_no_controller_stops_the_node_at_start(
    graph: Graph, tmp_path: Path, name: str, reason: str
) -> None:
    if name != "missing.json":
        (tmp_path / name).write_text("")
    process = graph.start(CONTROLLER, parameters={"controller_file": str(tmp_path / name)})
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 1
    assert process.said.count("\n") <= 1
    assert reason in process.said


def test_the_file_of_a_controller_is_read_back_bit_for_bit(tmp_path: Path) -> None:
    model = pd_as_linear(FILTERED)
    model.save(tmp_path / "controller.mat")
    read = StateSpaceModel.load(tmp_path / "controller.mat")
    for name in ("a", "b", "c", "d", "k"):
        np.testing.assert_array_equal(getattr(read, name), getattr(model, name))
    with pytest.raises(ParameterError, match="the machine 4 axes"):
        LinearController(model, LinearControllerParameters(), 4, 10_000.0)
