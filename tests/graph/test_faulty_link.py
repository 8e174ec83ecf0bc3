"""The bridge behind a link whose calls fail or wait, or whose target does what nobody has asked for."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from amb_msgs.msg import BridgeState
from amb_sim_node.rig_waits import STANDS_STILL
from tests.graph.conftest import Graph
from tests.graph.rig import Rig
from tests.unit.test_link_example import offer_link, write_example

MODULE = Path(__file__).parent / "faulty_link.py"


class FaultyRig(Rig):
    """A bridge with the faulty link, inactive."""

    def __init__(self, graph: Graph) -> None:
        write_example(graph.folder)
        shutil.copy(MODULE, graph.folder)
        offer_link(graph.folder, "faulty", "faulty_link:FaultyLink")
        path = graph.environment.get("PYTHONPATH", "")
        graph.environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(graph.folder), path)))
        self.faults: set[str] = set()
        super().__init__(graph, kind="faulty", bridge={"landing_time": 1.0})

    def begin(self, fault: str) -> None:
        (self.graph.folder / fault).touch()
        self.faults.add(fault)

    def end(self, *faults: str) -> None:
        for fault in faults:
            (self.graph.folder / fault).unlink()
            self.faults.remove(fault)

    @property
    def calls(self) -> list[str]:
        """The calls of the link."""
        path = self.graph.folder / "calls"
        return path.read_text().splitlines() if path.exists() else []

    def is_anew(self) -> bool:
        """Whether the bridge is unconfigured now, without any fault."""
        self.end(*self.faults)
        if self.life_cycle == "active":
            self.change("deactivate")
        if self.life_cycle == "inactive":
            self.change("cleanup")
        (self.graph.folder / "calls").unlink(missing_ok=True)
        return self.life_cycle == "unconfigured"


@pytest.fixture
def rig(share: Callable[..., FaultyRig]) -> FaultyRig:
    """Not configured; shared."""
    return share(FaultyRig, FaultyRig.is_anew)


def asked_for(rig: FaultyRig) -> bool:
    return "levitate is asked for" in rig.calls


def test_a_levitation_that_is_on_its_way_is_not_carried_out_after_the_currents_are_off(rig: FaultyRig) -> None:
    assert rig.change("configure")
    rig.begin("hold levitate")
    levitated = rig.asked("activate")
    rig.graph.wait_until(lambda: asked_for(rig), "the levitation")
    off = rig.graph.asked(Trigger, "/amb/hardware_bridge/off")
    rig.graph.wait_until(lambda: "off: asked for" in rig.bridge.said, "the request")
    rig.end("hold levitate")
    assert off().success
    assert not levitated()
    assert "levitate" in rig.calls
    assert rig.calls[-1] == "land 0"
    rig.graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the end of the currents")


def test_a_landing_that_fails_leaves_the_bridge_active_and_can_be_asked_for_again(rig: FaultyRig) -> None:
    rig.levitate()
    rig.begin("refuse landing")
    assert not rig.change("deactivate")
    assert rig.life_cycle == "active"
    rig.graph.wait_until(
        lambda: "deactivate: no reply from the target to DELEVITATE" in rig.state.problem, "the reason"
    )
    rig.end("refuse landing")
    assert rig.change("deactivate")
    assert rig.life_cycle == "inactive"
    rig.graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the landing")


def test_a_rotor_that_a_failed_levitation_has_left_up_can_be_landed(rig: FaultyRig) -> None:
    assert rig.change("configure")
    rig.begin("no samples")
    rig.begin("refuse landing")
    levitated = rig.asked("activate")
    assert not levitated()
    assert rig.life_cycle == "inactive"
    rig.graph.wait_until(lambda: "the rotor could not be landed: no reply" in rig.state.problem, "the reason")
    rig.end("no samples", "refuse landing")
    assert rig.change("deactivate")
    rig.graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the landing")
    assert not rig.change("deactivate")  # there is nothing to land any more


def test_a_levitation_ends_with_the_link(rig: FaultyRig) -> None:
    assert rig.change("configure")
    rig.begin("no samples")
    levitated = rig.asked("activate")
    rig.graph.wait_until(lambda: "levitate" in rig.calls, "the levitation")
    rig.begin("silent")
    assert not levitated()
    rig.graph.wait_until(lambda: "activate: no reply from the target" in rig.state.problem, "the reason")


def test_a_target_that_switches_off_by_itself_is_not_called_levitated(rig: FaultyRig) -> None:
    rig.levitate()
    rig.begin("switch off")
    rig.graph.wait_until(lambda: rig.life_cycle == "inactive", "the end")
    rig.end("switch off")
    assert rig.change("activate")


def test_a_target_without_control_steps_is_an_error_and_a_landing_says_so(rig: FaultyRig) -> None:
    rig.levitate()
    rig.begin("stand still")
    rig.graph.wait_until(lambda: STANDS_STILL in rig.state.problem, "the problem")
    rig.statuses.clear()
    rig.graph.wait_until(lambda: rig.health("hardware_bridge"), "diagnostics")
    status = rig.health("hardware_bridge")[-1]
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, STANDS_STILL)
    rig.begin("refuse landing")
    assert not rig.change("deactivate")
    rig.end("stand still", "refuse landing")
    rig.graph.wait_until(lambda: STANDS_STILL not in rig.state.problem, "its end")
    assert rig.change("deactivate")


def test_a_bridge_that_could_not_configure_knows_nothing_of_the_rig(rig: FaultyRig) -> None:
    rig.begin("refuse settings")
    assert not rig.change("configure")
    assert rig.calls == ["close"]
    assert rig.life_cycle == "unconfigured"
    rig.graph.wait_until(lambda: "configure: the target refuses PARAMETERS" in rig.state.problem, "the reason")
    assert rig.state.mode == BridgeState.UNREACHABLE
    rig.end("refuse settings")
    assert rig.change("configure")
