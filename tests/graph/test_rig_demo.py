"""The first session with an emulated rig, slower than real time as other programs run beside, to its end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.experiment import ExperimentRun
from amb_bringup.demos.rig_demo import HighestRegion
from amb_bringup.graph.packages import find_executable
from amb_core.ground.errors import AmbError
from amb_core.recording import Recording, audit_steps
from amb_msgs.msg import RegionState
from amb_ros.qos import HISTORY
from tests.graph.conftest import Graph
from tests.graph.rig import unhurried_file


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_session_levitates_excites_identifies_lands_and_reports(graph: Graph, tmp_path: Path) -> None:
    out = tmp_path / "session"
    command = [str(find_executable("amb_bringup", "amb")), "rig", "demo", "--out", str(out)]
    process = graph.start_command([*command, "--params", str(unhurried_file(tmp_path))])
    process.wait_for_end(800.0)
    assert process.returncode == 0, process.said
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["axes"], summary["region"], summary["trips"]) == (["x", "y"], "A", [])
    assert summary["unstable_poles"] == 2
    assert summary["frf_error_percent"] < 3.0
    assert min(summary["fit"].values()) > 90.0
    assert summary["load"] < 1.0
    audit = audit_steps(out / "bag", summary["run"])
    assert audit.lost(0, summary["steps"]) == summary["lost"]
    assert (audit.doubled, audit.out_of_order) == (0, 0)
    recording = Recording.read(out / "bag")
    assert recording.controller() is not None
    assert (out / "report.html").stat().st_size > 100_000


def test_a_region_reached_at_the_very_end_of_an_excitation_ends_the_session(graph: Graph) -> None:
    monitor = graph.node.create_publisher(RegionState, "/amb/region", HISTORY)
    monitor.publish(RegionState(run=1, region=RegionState.A, next_step=500))
    done = ExperimentRun("sweep", run=1, first_step=100, steps=900, wall=1.0)
    with AmbClient(domain_id=graph.domain, timeout=2.0, nodes=()) as client:
        highest = HighestRegion(client)
        with pytest.raises(ClientError, match="sweep: no region up to step 1000 received; is region_monitor running"):
            highest.require_a(done)
        monitor.publish(RegionState(run=1, region=RegionState.B, next_step=1000))
        with pytest.raises(AmbError, match="the rotor left region A during the sweep: region B"):
            highest.require_a(done)
