"""The bridge's side of an excitation with a link that fails as the test says: what plays, and what is said of it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig import ExcitationProtection, ProtectionParameters, Runs
from amb_core.rig.link import ExcitationPhase, Limits, TargetState, TargetStatus, TelemetryBlock, TooLateError
from amb_msgs.msg import AxisReference, Excitation, ExcitationStatus
from amb_ros.qos import EVERY_STATE
from amb_sim_node.rig_excitation import Rig, RigExcitation
from tests.graph.conftest import Graph
from tests.target_rig import machine

MACHINE = machine(2)
BASE = 1_000  # step of the target at step 0 of the run
STEPS = 5_000  # of an excitation
UPLOAD = 300  # steps that an upload takes
FADE = round(Limits().fade_time * MACHINE.sample_rate)
FORMER, NEW = 1, 2


class Link:
    """A target whose steps go on by commands alone; `lost` names commands that are carried out without a reply."""

    def __init__(self) -> None:
        self.step = BASE + 500
        self.phase = ExcitationPhase.NONE
        self.log: list[str] = []
        self.lost: set[str] = set()
        self.refused = ""

    def status(self) -> TargetStatus:
        if self.phase is ExcitationPhase.FADING:
            self.step, self.phase = self.step + FADE, ExcitationPhase.NONE
        numbers = (0,) * 6
        flags = (False,) * 5
        return TargetStatus(self.step, TargetState.LEVITATED, self.phase, *flags, *numbers, trips=())

    def disarm(self) -> None:
        plays = self.phase is ExcitationPhase.PLAYING
        self.phase = ExcitationPhase.FADING if plays else ExcitationPhase.NONE
        self._reply("disarm")

    def upload(self, samples: np.ndarray, _cancelled: Callable[[], bool]) -> Callable[[int], None]:
        if self.refused:
            raise TargetError(self.refused)
        self.step += UPLOAD
        self._reply("upload")

        def arm(step: int) -> None:
            if step < self.step:
                raise TooLateError(step, self.step)
            self.phase = ExcitationPhase.ARMED
            self._reply("arm")

        return arm

    def _reply(self, command: str) -> None:
        self.log.append(command)
        if command in self.lost:
            raise TargetError(f"no reply from the target to {command.upper()}")


class Bridge:
    """The excitations of a bridge whose target plays one already."""

    def __init__(self, graph: Graph) -> None:
        self.graph, self.link = graph, Link()
        self.answers: list[ExcitationStatus] = []
        self.runs = Runs(MACHINE, 100, itertools.count(7).__next__)
        self.take_telemetry(BASE, BASE + 500)
        protection = ExcitationProtection(ProtectionParameters(), Limits(), MACHINE, 100_000)
        rig: Any = Rig(self.link, MACHINE, self.runs, protection, lambda _signal: None)  # type: ignore[arg-type]
        self.excitation = RigExcitation(graph.add_node("bridge", namespace="amb"), lambda: rig)
        self._publisher = graph.node.create_publisher(Excitation, "/amb/excitation", EVERY_STATE)
        graph.node.create_subscription(ExcitationStatus, "/amb/excitation_status", self.answers.append, EVERY_STATE)
        graph.wait_until(self._publisher.get_subscription_count, "the bridge")
        graph.wait_until(lambda: graph.node.count_publishers("/amb/excitation_status"), "its answers")
        assert self.start(FORMER).accepted
        self.link.phase = ExcitationPhase.PLAYING
        self.link.step = BASE + 1_000
        self.take_telemetry(BASE + 500, BASE + 1_000)
        self.link.log.clear()
        self.answers.clear()

    def take_telemetry(self, first: int, stop: int) -> None:
        zeros = np.zeros((stop - first, 2))
        status = np.full(stop - first, int(TargetState.LEVITATED), np.uint32)
        self.runs.add(TelemetryBlock(first, 0, zeros, zeros, zeros, None, status))

    def start(self, number: int, first_step: int = -1, **changes: Any) -> ExcitationStatus:
        """The last answer to an excitation of this number."""
        samples = AxisReference(name="x_0", reference=np.full(STEPS, 1e-6))
        fields = {"kind": "waveform", "sample_time": 1.0 / MACHINE.sample_rate, "axes": [samples]} | changes
        self._publisher.publish(Excitation(run=7, id=number, first_step=first_step, **fields))
        return self.answer(number)

    def answer(self, number: int) -> ExcitationStatus:
        def mine() -> list[ExcitationStatus]:
            return [answer for answer in self.answers if answer.id == number]

        self.graph.wait_until(mine, f"an answer to excitation {number}")
        return mine()[-1]

    def ends(self) -> list[tuple[int, int]]:
        """Number and step of what has been reported as ended, before the last answer."""
        ended = [answer for answer in self.answers if answer.kind == "stop" and answer.accepted]
        return [(answer.id, answer.first_step) for answer in ended]


@pytest.fixture
def bridge(graph: Graph) -> Any:
    bridge = Bridge(graph)
    yield bridge
    bridge.excitation.close()


@pytest.mark.parametrize("first_step", [1_000 - 1, 1_000 + FADE - 1], ids=["passed", "passes while the former fades"])
def test_a_start_that_must_come_too_late_is_refused_and_the_former_goes_on(bridge: Bridge, first_step: int) -> None:
    answer = bridge.start(NEW, first_step)
    assert not answer.accepted
    assert "allowed" in answer.message
    assert bridge.link.log == []
    assert bridge.link.phase is ExcitationPhase.PLAYING
    assert bridge.ends() == []


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"axes": [AxisReference(name="z", reference=[0.0])]}, "is not an axis of this machine"),
        ({"axes": [AxisReference(name="x_0", reference=np.zeros(150_000))]}, "15 s long; allowed on this rig: 10 s"),
        ({"axes": [AxisReference(name="x_0", reference=np.full(10, 5e-4))]}, "amplitude of 500 um"),
    ],
)
def test_what_the_bridge_itself_can_refuse_leaves_the_former_alone(bridge: Bridge, changes: Any, reason: str) -> None:
    answer = bridge.start(NEW, **changes)
    assert not answer.accepted
    assert reason in answer.message
    assert bridge.link.log == []
    assert bridge.ends() == []


def test_a_start_that_is_too_late_after_its_upload_ends_the_former_and_says_so(bridge: Bridge) -> None:
    answer = bridge.start(NEW, 1_000 + FADE + UPLOAD - 1)
    assert not answer.accepted
    assert f"allowed for first_step: {1_000 + FADE + UPLOAD} or later" in answer.message
    assert bridge.ends() == [(FORMER, 1_000)]
    assert [answer.id for answer in bridge.answers] == [FORMER, NEW], "the end comes before the refusal"
    assert bridge.link.phase is ExcitationPhase.NONE


@pytest.mark.parametrize("lost", ["upload", "arm"])
def test_a_start_whose_reply_is_lost_leaves_nothing_armed(bridge: Bridge, lost: str) -> None:
    bridge.link.lost = {lost}
    answer = bridge.start(NEW)
    assert not answer.accepted
    assert f"no reply from the target to {lost.upper()}" in answer.message
    assert bridge.link.phase is ExcitationPhase.NONE
    assert bridge.link.log[-1] == "disarm"
    assert bridge.ends() == [(FORMER, 1_000)]


def test_a_start_that_can_be_neither_armed_nor_stopped_says_that_it_may_play(bridge: Bridge) -> None:
    bridge.link.lost = {"disarm"}
    answer = bridge.start(NEW)
    assert not answer.accepted
    assert "the target may play it nevertheless, and could not be stopped" in answer.message


def test_what_has_ended_before_it_began_is_applied_again_if_it_is_sent_again(bridge: Bridge) -> None:
    """As by a generator that has not heard of the end: it was taken for the copy of one that is armed."""
    armed = 3
    assert bridge.start(armed, 50_000).accepted
    bridge.link.refused = "the target refuses BEGIN: a value is not allowed"
    assert not bridge.start(NEW).accepted
    assert bridge.ends() == [(FORMER, 1_000), (armed, 1_000)]
    bridge.link.refused = ""
    bridge.answers.clear()
    assert bridge.start(armed, 50_000).accepted
    assert bridge.link.phase is ExcitationPhase.ARMED


@pytest.mark.parametrize("step", [BASE + 1_200, 3], ids=["by a trip", "by a reboot"])
def test_an_excitation_that_the_target_ends_is_reported_once(bridge: Bridge, step: int) -> None:
    bridge.excitation.end(step)
    bridge.excitation.end(step)
    bridge.link.phase = ExcitationPhase.NONE
    assert bridge.start(NEW).accepted
    assert bridge.ends() == [(FORMER, 1_000)]


def test_an_excitation_that_has_played_to_its_end_is_not_reported(bridge: Bridge) -> None:
    bridge.link.phase = ExcitationPhase.NONE
    bridge.link.step = BASE + 10_000
    bridge.excitation.end(bridge.link.step)
    assert bridge.start(NEW).accepted
    assert bridge.ends() == []
