"""The two Python programs of the README run as they stand there, one after the other, against a graph."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tests.graph.limits import TEST_TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

README = Path(__file__).parents[2] / "README.md"
NODES = (
    "amb_sim_node.simulator",
    "amb_controller_node.pd_controller",
    "amb_controller_node.excitation_generator",
    "amb_ident_node.region_monitor",
    "amb_ident_node.identifier",
    "amb_ident_node.recorder",
)


def test_one_records_and_identifies_and_a_node_identifies_the_same_bag(graph: Graph) -> None:
    recording, asking = re.findall(r"^```python\n(.*?)^```$", README.read_text(), re.DOTALL | re.MULTILINE)
    for module in NODES:
        graph.start(module)
    said = []
    for code in (recording, asking):
        program = graph.start_command([sys.executable, "-c", code], stdout=subprocess.PIPE)
        output, errors = program.communicate(timeout=TEST_TIMEOUT)
        assert program.returncode == 0, errors
        said.append(output.strip())
    assert re.match(r"validated\S* \[9[89]\.\d+ 9[89]\.\d+\] \[1\.02\S+ 1\.02\S+\]$", said[0])
    assert re.match(r"validated .*order 10, 40000 samples: .*2 unstable plant poles; closed loop stable", said[1])
