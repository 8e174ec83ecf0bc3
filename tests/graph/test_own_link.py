"""The link of one's own that docs/how-to/connect-a-rig.md shows, behind the bridge."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from amb_core.excitation import Square, generate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from tests.graph.conftest import Graph
from tests.graph.rig import Rig
from tests.unit.test_link_example import write_example

SQUARE = Square(amplitude=10e-6, duration=0.2, frequency=20.0)


def test_the_bridge_drives_a_link_of_ones_own_as_it_drives_amb_udp(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_example(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    rig = Rig(graph, kind="vendor")
    graph.start("amb_controller_node.excitation_generator")
    run = rig.levitate()
    answer = rig.excite(SQUARE)
    assert answer.success, answer.message
    steps = answer.first_step + answer.steps
    plant = Plant(PlantParameters())
    samples = generate(SQUARE, plant.machine.sample_rate, plant.machine).samples
    expected = simulate(plant, PdController(ControllerParameters()), steps, samples, answer.first_step)
    assert rig.record(run, steps).identical_to(expected)
    assert rig.change("deactivate"), rig.state.problem
    assert rig.change("cleanup"), rig.state.problem
