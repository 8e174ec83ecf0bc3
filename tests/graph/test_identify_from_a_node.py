"""The node of docs/how-to/own-controller.md, taken from there, levitates the simulated bearing with its model."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from amb_core.excitation import Square
from amb_msgs.msg import RotorPosition, SimulatorState
from amb_msgs.srv import RunSteps
from amb_ros.qos import STREAM

if TYPE_CHECKING:
    from tests.graph.bearing import Bearing
    from tests.graph.conftest import Graph

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own-controller.md"
SHAKEN_FROM = 1_000
SQUARE = Square(amplitude=20e-6, duration=0.5, frequency=20.0, axes="in_turn")
STEPS = 2_000


def test_a_node_of_another_package_closes_the_loop_with_the_identified_model(graph: Graph, bearing: Bearing) -> None:
    _, code = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    graph.start("amb_sim_node.simulator")
    pd_controller = graph.start("amb_controller_node.pd_controller")
    graph.start("amb_controller_node.excitation_generator")
    graph.start("amb_ident_node.identifier")
    run = bearing.reset()
    bearing.excite(SQUARE, run, SHAKEN_FROM)
    steps = SHAKEN_FROM + round(SQUARE.duration * 1e4)
    bearing.run(steps)
    bearing.record(run, steps)

    graph.start_command([sys.executable, "-c", code])
    graph.wait_until(lambda: graph.node.count_publishers("/amb/current_reference") == 2, "the model and its controller")
    graph.stop(pd_controller)
    positions: list[RotorPosition] = []
    graph.node.create_subscription(RotorPosition, "/amb/position", positions.append, STREAM)
    graph.wait_until(lambda: graph.node.count_subscribers("/amb/position") == 2, "the end of pd_controller")
    run = bearing.reset()
    graph.call(RunSteps, "/amb/simulator/run", steps=STEPS)
    bearing.wait_for_step(run, STEPS)
    assert bearing.states[-1].mode == SimulatorState.PAUSED, "the rotor does not touch"
    graph.wait_until(lambda: len(positions) >= STEPS, "all positions")
    settled = np.array([position.position for position in positions[STEPS // 2 :]])
    assert np.abs(settled - settled.mean(axis=0)).max() < 1e-6, "it rests"
    assert np.abs(settled.mean(axis=0) - (0.0, -66e-6)).max() < 10e-6, "where the model is about"
