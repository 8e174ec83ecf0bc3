"""The second before a trip in its message, although nothing of four seconds of telemetry has reached the bridge."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import pytest

from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_msgs.msg import Trip
from tests.graph.conftest import Graph
from tests.graph.rig import Rig


def test_the_second_before_a_trip_is_whole_though_telemetry_was_lost_for_four_seconds(graph: Graph) -> None:
    rig = Rig(graph, emulator={"real_time_factor": 1.0})
    run = rig.levitate()
    rig.wait_for_step(1_000)
    trip, lost = _trip_in_silence(rig)
    assert (trip.run, trip.reason) == (run, Trip.AMPLIFIER)
    assert lost > 40_000
    blocks = [block_from_message(block) for block in trip.before]
    assert sum(block.steps for block in blocks) == 10_000
    assert blocks[0].first_step == trip.step - 10_000
    assert all(later.first_step == block.first_step + block.steps for block, later in itertools.pairwise(blocks))
    assert "missing" not in trip.text


OWN_LINKS = """
from amb_core.ground.errors import TargetError
from amb_core.rig.link import AmbUdpLink, NoRecordError

class Forgetful(AmbUdpLink):
    def __init__(self, parameters):
        super().__init__(port=parameters.port, timeout=parameters.timeout, silence=parameters.silence)
        self.asked = 0

    def trip_record(self):
        raise NoRecordError("its memory is full")

class Interrupted(Forgetful):
    def trip_record(self):
        self.asked += 1
        if self.asked < 3:
            raise TargetError("no reply")
        return AmbUdpLink.trip_record(self)
"""


@pytest.fixture
def own_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Links of AMB-UDP that cannot read what a target keeps, or not at once."""
    (tmp_path / "own_links.py").write_text(OWN_LINKS)
    installed = tmp_path / "own_links-1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: own_links\nVersion: 1.0\n")
    offers = "forgetful = own_links:Forgetful\ninterrupted = own_links:Interrupted\n"
    (installed / "entry_points.txt").write_text(f"[amb.links]\n{offers}")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)


@pytest.mark.usefixtures("own_links")
def test_what_the_target_keeps_is_asked_for_again_when_the_link_was_interrupted(graph: Graph) -> None:
    rig = Rig(graph, emulator={"real_time_factor": 1.0}, bridge={"link.kind": "interrupted"})
    rig.levitate()
    rig.wait_for_step(1_000)
    trip, _ = _trip_in_silence(rig)
    assert sum(steps_in(block) for block in trip.before) == 10_000
    assert "missing" not in trip.text


@pytest.mark.usefixtures("own_links")
def test_a_trip_reports_what_is_missing_and_why_the_target_did_not_have_it(graph: Graph) -> None:
    rig = Rig(graph, emulator={"real_time_factor": 1.0}, bridge={"link.kind": "forgetful"})
    rig.levitate()
    rig.wait_for_step(1_000)
    trip, _ = _trip_in_silence(rig)
    kept = sum(steps_in(block) for block in trip.before)
    assert kept < 10_000
    expected = f"{10_000 - kept} of the 10000 steps before it are missing here; the record of the target is not there"
    assert f"{expected}: its memory is full" in trip.text


def _trip_in_silence(rig: Rig) -> tuple[Trip, int]:
    """A trip while nothing of four seconds reaches the bridge; how many samples were lost."""

    def steps() -> int:
        return int(rig.values("target_emulator")["steps"])

    rig.set("target_emulator", faults__to_host__loss=1.0)
    began = steps()
    rig.graph.wait_until(lambda: steps() > began + 40_000, "four seconds")
    rig.set("target_emulator", faults__amplifier=True)
    rig.graph.wait_until(lambda: rig.values("target_emulator")["trips"] != "none" or steps() > began + 60_000, "a trip")
    rig.set("target_emulator", faults__to_host__loss=0.0)
    rig.graph.wait_until(lambda: bool(rig.trips), "the trip")
    return rig.trips[0], int(rig.state.lost)
