"""The end of a session of experiments: the rotor is landed and the bag closed, or the error says what is left."""

from __future__ import annotations

import re
import signal
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from lifecycle_msgs.msg import State
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client import rig as rig_client
from amb_bringup.client.errors import ClientError, EndError
from amb_bringup.client.experiment import RigStand, has_ended, landing
from amb_bringup.client.rig import Rig
from amb_bringup.experiments import commissioning, experiment_session
from amb_bringup.graph.packages import LaunchError
from amb_core.rig.commissioning import CommissioningSettings, Step
from amb_msgs.msg import BridgeState
from amb_sim_node.bridge_parameters import BridgeParameters

REFUSED = "deactivate is not allowed while inactive; allowed: cleanup, activate, shutdown"


class Bridge:
    """A bridge that answers at once, its node, and the client in whose graph it is: as much of them as Rig needs."""

    timeout = 1.0

    def __init__(
        self, mode: int = BridgeState.OFF, life_cycle: str = "inactive", answers: dict[str, str] | None = None
    ):
        self.mode, self.label, self.answers = mode, life_cycle, {"deactivate": ""} | (answers or {})
        self.asked: list[str] = []
        self.closed: list[tuple[int, int]] = []
        self.node = self
        self.rig = Rig(self)  # type: ignore[arg-type]
        self.rig.state = BridgeState(mode=mode, run=5, step=100, sequence=1)

    def create_client(self, _kind: Any, name: str) -> Any:
        call = self._change if name.endswith("change_state") else self._state
        return SimpleNamespace(service_is_ready=lambda: True, call_async=call, remove_pending_request=lambda _: None)

    def get_namespace(self) -> str:
        return "/amb"

    def wait_until(self, condition: Any, _timeout: float = 0.0, complaint: str = "") -> None:
        if not any(condition() for _ in range(2)):  # the first look may only send a request
            raise ClientError(complaint)

    def process_arrived(self) -> None:
        """Nothing: it answers at once."""

    def stop_recording(self, run: int = 0, step: int = 0) -> str:
        self.closed.append((run, step))
        return ""

    def _state(self, _request: Any) -> Any:
        return _answer(SimpleNamespace(current_state=State(label=self.label)))

    def _change(self, request: Any) -> Any:
        """Answer with the text of a failure, empty for success; with nothing if there is none, as a busy worker."""
        label = request.transition.label
        self.asked.append(label)
        if label not in self.answers:
            return SimpleNamespace(done=lambda: False)
        problem = self.answers[label]
        self.rig.state = BridgeState(mode=self.mode, run=5, step=100, sequence=2, problem=problem)
        return _answer(SimpleNamespace(success=not problem))


def _answer(content: Any) -> Any:
    return SimpleNamespace(done=lambda: True, result=lambda: content)


@pytest.fixture(autouse=True)
def _no_subscriptions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig_client, "create_subscription", lambda *_: None)


def interrupted(bridge: Bridge, levitates: bool = True) -> BaseException:
    """A recorded session that is interrupted after it has asked to levitate; returns what it raises."""
    stand = RigStand(bridge, lambda *_: None)  # type: ignore[arg-type]
    with pytest.raises((KeyboardInterrupt, ClientError)) as caught, landing(stand, recorded=True):
        if levitates:
            try:
                stand.levitate()
            except ClientError:
                raise KeyboardInterrupt from None
        raise KeyboardInterrupt
    return caught.value


def test_an_activation_that_waits_for_the_bridge_is_called_off() -> None:
    bridge = Bridge()  # inactive and off, as long as its worker is busy
    assert isinstance(interrupted(bridge), KeyboardInterrupt)
    assert bridge.asked == ["activate", "deactivate"]


def test_a_rotor_that_an_inactive_bridge_could_not_land_is_landed() -> None:
    bridge = Bridge(BridgeState.LEVITATED, answers={"activate": "activate: the rotor could not be landed"})
    interrupted(bridge)
    assert bridge.asked == ["activate", "deactivate"]


@pytest.mark.parametrize("mode", [BridgeState.OFF, BridgeState.TRIPPED])
def test_nothing_is_left_to_do_if_the_bridge_refuses_to_land_a_rotor_that_is_down(mode: int) -> None:
    bridge = Bridge(mode, answers={"deactivate": REFUSED})
    assert isinstance(interrupted(bridge), KeyboardInterrupt)
    assert bridge.closed == [(5, 100)]


@pytest.mark.parametrize("mode", [BridgeState.LEVITATED, BridgeState.UNREACHABLE])
def test_a_refusal_to_land_any_other_is_reported(mode: int) -> None:
    problem = interrupted(Bridge(mode, answers={"deactivate": REFUSED}))
    assert str(problem).startswith("interrupted; then, at the end: not landed: hardware_bridge: deactivate is not")
    assert str(problem).endswith("; look at the rig")


def test_a_rotor_that_another_host_levitates_is_left_alone() -> None:
    bridge = Bridge(BridgeState.LEVITATED)
    interrupted(bridge, levitates=False)
    assert bridge.asked == []


def test_the_recording_is_closed_although_the_landing_fails_and_all_that_is_left_is_reported() -> None:
    bridge = Bridge(BridgeState.LEVITATED, answers={"deactivate": "deactivate: no reply from the target"})
    problem = interrupted(bridge)
    assert bridge.closed == [(0, 0)]
    assert str(problem) == (
        "interrupted; then, at the end: not landed: hardware_bridge: deactivate: no reply from the target; look at "
        "the rig"
    )
    bridge.stop_recording = lambda *_: _refuse("the disk is full")  # type: ignore[method-assign]
    assert str(interrupted(bridge)).endswith("look at the rig; the recording is not closed: the disk is full")


def test_a_commissioning_lands_although_it_is_interrupted_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge = Bridge(life_cycle="active")
    monkeypatch.setattr(bridge.rig, "connect", lambda: None)
    monkeypatch.setattr(commissioning, "create_subscription", lambda *_: None)
    monkeypatch.setattr(commissioning, "Measurements", lambda *_: SimpleNamespace(run=1))
    monkeypatch.setattr(commissioning, "require_rest", lambda *_: None)

    def interrupt(step: Step) -> None:
        if step.name == "landing" and not step.began:
            signal.raise_signal(signal.SIGINT)

    def spend(_session: commissioning.Session, _seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(commissioning.Session, "_spend", spend)
    amb: Any = bridge
    session = commissioning.Session(
        amb, CommissioningSettings(), BridgeParameters(), None, None, None, lambda: None, interrupt, wiring=False
    )
    with pytest.raises(KeyboardInterrupt):
        session.carry_out(tmp_path / "bag")
    assert bridge.asked == ["deactivate"]


@pytest.mark.parametrize(
    ("problem", "text"),
    [(ValueError("no\nnumber"), r"internal error: ValueError('no\nnumber')"), (ClientError("no disk"), "no disk")],
)
def test_a_commissioning_that_ends_in_an_error_has_not_passed(
    problem: Exception, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge = Bridge(life_cycle="unconfigured")
    monkeypatch.setattr(commissioning, "create_subscription", lambda *_: None)
    monkeypatch.setattr(commissioning, "Measurements", lambda *_: SimpleNamespace(run=1))
    monkeypatch.setattr(commissioning.Session, "_connect", lambda _: [])
    amb: Any = bridge
    amb.start_recording = lambda _: _raise(problem)
    session = commissioning.Session(
        amb, CommissioningSettings(), BridgeParameters(), None, None, None, lambda: None, lambda _: None, wiring=False
    )
    with suppress(ValueError):  # an internal error is reported; a problem of the rig leads to the landing
        session.carry_out(tmp_path / "bag")
    first = session.protocol.steps[0]
    assert (first.name, first.result, first.problem) == ("connection", "failed", text)
    assert session.protocol.to_json()["result"] == "failed"


def _raise(problem: Exception) -> None:
    raise problem


def test_ctrl_c_during_the_end_neither_stops_it_nor_hides_what_is_left_to_do() -> None:
    def answer(_request: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return change(_request)

    for problem, ended in (("", True), ("deactivate: no reply from the target", False)):
        bridge = Bridge(life_cycle="active", answers={"deactivate": problem})
        change = bridge.rig._change.call_async
        bridge.rig._change.call_async = answer  # type: ignore[assignment, method-assign]
        raised = interrupted(bridge, levitates=False)
        assert bridge.closed
        assert isinstance(raised, EndError) is not ended
        assert has_ended(raised) is ended


def test_a_node_that_has_ended_is_named_beside_what_is_left_to_do() -> None:
    reason = "node hardware_bridge was killed by SIGKILL; its last output: (nothing)"

    def check() -> None:
        raise LaunchError(reason)

    graph: Any = SimpleNamespace(check=check)
    left = EndError("no answer; then, at the end: not landed: no node hardware_bridge; look at the rig")
    with pytest.raises(EndError, match=re.escape(f"{reason}; {left}")):
        experiment_session._blame_ended_node(graph, left)
    with pytest.raises(LaunchError, match=re.escape(reason)):
        experiment_session._blame_ended_node(graph, ClientError("no answer"))


def _refuse(reason: str) -> str:
    raise ClientError(reason)


@pytest.mark.parametrize(("lands", "line"), [(True, True), (False, False)])
def test_the_command_says_landed_only_if_the_end_of_the_session_did(
    lands: bool, line: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge = Bridge(answers={"deactivate": "" if lands else "deactivate: no reply from the target"})

    def session(_experiments: Any, bag: Path, *_: Any) -> Any:
        bag.mkdir()
        raise interrupted(bridge)

    monkeypatch.setattr(experiment_session, "run_session", session)
    words = ["multisine", "--amplitude", "2um", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["experiment", *words])
    assert ("landed; the recording is closed: " in result.output) is line
    assert lands or "not landed: " in str(result.exception)


def test_the_command_says_nothing_of_a_session_that_did_not_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def session(_experiments: Any, bag: Path, *_: Any) -> Any:
        bag.mkdir()
        raise ClientError("no answer from /amb/recorder/start within 60 s")

    monkeypatch.setattr(experiment_session, "run_session", session)
    result = CliRunner().invoke(app, ["experiment", "multisine", "--amplitude", "2um", "--out", str(tmp_path / "out")])
    assert "landed" not in result.output
