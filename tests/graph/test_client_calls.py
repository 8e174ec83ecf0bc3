"""Calls of a client against nodes of the test: late states, runs that others end, requests of two threads."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from amb_bringup.client import AmbClient, ClientError, RunEnd
from amb_msgs.msg import AxisRegion, BearingRegion, BridgeState, RegionState, SimulatorState
from amb_msgs.srv import Pause, RunSteps, StopRecording
from amb_ros import topics
from amb_ros.qos import EVERY_STATE, HISTORY
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

SHORT = 2.0  # s; for calls that end with a time-out
PERIOD = 500  # steps between states of the monitor


class Simulator:
    """Publishes states as a simulator does, and answers requests. Its node has another name."""

    def __init__(self, graph: Graph) -> None:
        self._states = graph.node.create_publisher(SimulatorState, "/amb/simulator/state", EVERY_STATE)
        self.pauses = 0
        self.on_run: Callable[[], None] = lambda: None  # called before the answer to a request to run
        graph.node.create_service(RunSteps, "/amb/simulator/run", self._run)
        graph.node.create_service(Pause, "/amb/simulator/pause", self._pause)

    def publish(self, run: int, step: int, mode: int = SimulatorState.PAUSED) -> None:
        self._states.publish(SimulatorState(run=run, step=step, mode=mode))

    def _run(self, request: RunSteps.Request, response: RunSteps.Response) -> RunSteps.Response:
        self.on_run()
        response.success, response.run, response.last_step = True, 5, request.steps
        return response

    def _pause(self, _: Pause.Request, response: Pause.Response) -> Pause.Response:
        self.pauses += 1
        response.success, response.step = True, 7
        return response


class Monitor:
    """Publishes states as the region monitor does."""

    def __init__(self, graph: Graph) -> None:
        self._regions = graph.node.create_publisher(RegionState, "/amb/region", HISTORY)

    def publish(self, run: int, steps: range) -> None:
        """A state before each of these steps."""
        for step in steps:
            axes, bearings = [AxisRegion(name="x")], [BearingRegion(name="a")]
            self._regions.publish(RegionState(run=run, step=step - 1, next_step=step, axes=axes, bearings=bearings))


@pytest.fixture
def simulator(graph: Graph) -> Simulator:
    return Simulator(graph)


def client_of(graph: Graph, timeout: float = TIMEOUT) -> AmbClient:
    """A client that has found the simulator of the test."""
    client = AmbClient(domain_id=graph.domain, timeout=timeout)
    for service in ("run", "pause"):
        client.wait_until(lambda name=service: client.node.count_services(f"/amb/simulator/{name}") > 0, TIMEOUT)
    return client


# -- regions


def test_the_region_is_the_last_one_of_the_present_run(graph: Graph, simulator: Simulator) -> None:
    monitor = Monitor(graph)
    monitor.publish(1, range(PERIOD, 500 * PERIOD, PERIOD))
    monitor.publish(2, range(PERIOD, 501 * PERIOD, PERIOD))
    simulator.publish(2, 500 * PERIOD)
    with client_of(graph) as client:
        assert client.region_state().step == 500 * PERIOD - 1
        simulator.publish(2, 501 * PERIOD)
        client.wait_until(lambda: client.simulator_state.step == 501 * PERIOD)
        monitor.publish(2, range(501 * PERIOD, 501 * PERIOD + 1))
        assert client.region_state().step == 501 * PERIOD - 1


def test_a_region_of_an_earlier_run_is_not_returned(graph: Graph, simulator: Simulator) -> None:
    Monitor(graph).publish(1, range(PERIOD, 10 * PERIOD, PERIOD))
    simulator.publish(1, 9 * PERIOD)
    with client_of(graph, SHORT) as client:
        assert client.region_state().step == 9 * PERIOD - 1
        simulator.publish(2, 0)
        client.wait_until(lambda: client.simulator_state.run == 2, TIMEOUT)
        with pytest.raises(ClientError, match="no region of the present run received"):
            client.region_state()


@pytest.mark.parametrize("mode", [None, SimulatorState.WAITING], ids=["an unknown loop", "a loop that waits"])
def test_the_last_region_is_returned_where_no_other_follows(
    graph: Graph, simulator: Simulator, mode: int | None
) -> None:
    Monitor(graph).publish(1, range(PERIOD, 10 * PERIOD, PERIOD))
    if mode is not None:
        simulator.publish(1, 9 * PERIOD + 1, mode)
    with client_of(graph) as client:
        assert client.region_state().step == 9 * PERIOD - 1


# -- runs


@pytest.mark.parametrize(
    ("states", "reason"),
    [
        ([(5, 3, SimulatorState.RUNNING), (6, 0, SimulatorState.PAUSED)], "run 5 was ended by .* present run is 6"),
        ([(6, 0, SimulatorState.PAUSED)], "run 5 was ended by a reset or a restart of the simulator"),
    ],
    ids=["in its middle", "before its first state"],
)
def test_a_run_that_another_client_ends_is_an_error_at_once(
    graph: Graph, simulator: Simulator, states: list[tuple[int, int, int]], reason: str
) -> None:
    simulator.on_run = lambda: [simulator.publish(*state) for state in states]
    with client_of(graph) as client, pytest.raises(ClientError, match=reason):
        client.run(100)


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (None, "no state of run 5 within 2 s; is the simulator running"),
        ((4, 9, SimulatorState.PAUSED), "no state of run 5 within 2 s; is the simulator running"),
        ((5, 3, SimulatorState.WAITING), "stood at step 3 for 2 s: .* waited for the controller .* are both running"),
        ((5, 3, SimulatorState.RUNNING), "no state after step 3 of run 5 within 2 s; is the simulator running"),
        ((5, 0, SimulatorState.PAUSED), "paused at step 0"),
    ],
)
def test_a_run_that_stands_says_who_is_waited_for(
    graph: Graph, simulator: Simulator, state: tuple[int, int, int] | None, reason: str
) -> None:
    simulator.on_run = lambda: None if state is None else simulator.publish(*state)
    with client_of(graph, SHORT) as client, pytest.raises(ClientError, match=reason):
        client.run(100)


def test_a_simulator_that_answers_is_called_whatever_the_name_of_its_node(graph: Graph, simulator: Simulator) -> None:
    with client_of(graph) as client:
        assert "simulator" not in client.node_names()
        assert client.pause() == 7
    assert simulator.pauses == 1


# -- recordings


def test_a_recorder_has_half_the_time_to_report_what_is_missing(graph: Graph) -> None:
    received: list[float] = []

    def stop(request: StopRecording.Request, response: StopRecording.Response) -> StopRecording.Response:
        received.append(request.timeout)
        return response

    service = graph.node.create_service(StopRecording, "/amb/recorder/stop", stop)
    service.send_response = lambda *_: None
    with (
        AmbClient(domain_id=graph.domain, timeout=SHORT, nodes=()) as client,
        pytest.raises(ClientError, match="no answer from /amb/recorder/stop within 2 s"),
    ):
        client.wait_until(lambda: client.node.count_services("/amb/recorder/stop") > 0, TIMEOUT)
        client.stop_recording(1, 100)
    assert received == [0.5 * SHORT]


# -- settings


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda client: client.start_excitation("sweep", run=3), "run"),
        (lambda client: client.preview_excitation("sweep", map="map.json"), "map"),
    ],
)
def test_a_field_that_the_client_fills_in_is_no_setting(
    domain: int, call: Callable[[AmbClient], Any], name: str
) -> None:
    with AmbClient(domain_id=domain) as client, pytest.raises(ClientError) as caught:
        call(client)
    reason, allowed = str(caught.value).split("; allowed: ")
    assert reason == f"'{name}' is no setting: the client fills it in"
    assert "amplitude" in allowed and not {"kind", "first_step", name} & set(allowed.split(", "))


# -- states of a rig


def test_the_state_of_a_rig_is_the_latest_however_long_nothing_was_called(graph: Graph, simulator: Simulator) -> None:
    """A rotor that has fallen meanwhile must not be called levitated."""
    bridge = graph.node.create_publisher(BridgeState, f"/amb/{topics.BRIDGE_STATE}", EVERY_STATE)
    with client_of(graph) as client:
        graph.wait_until(lambda: client.rig and bridge.get_subscription_count() > 0, "the client")
        bridge.publish(BridgeState(mode=BridgeState.LEVITATED, step=1))
        assert client.rig.wait_for_state().mode == BridgeState.LEVITATED
        for step in range(2, 50):
            bridge.publish(BridgeState(mode=BridgeState.TRIPPED, step=step))
        assert bridge.wait_for_all_acked()
        assert client.rig.wait_for_state().mode == BridgeState.TRIPPED


# -- threads


def test_a_call_while_another_thread_is_in_one_is_refused_before_anything_is_sent(
    graph: Graph, simulator: Simulator
) -> None:
    simulator.on_run = lambda: simulator.publish(5, 3, SimulatorState.RUNNING)
    running = threading.Event()
    ends: list[RunEnd] = []
    with client_of(graph) as client:
        thread = threading.Thread(target=lambda: ends.append(client.run(100, lambda _: running.set())))
        thread.start()
        try:
            assert running.wait(TIMEOUT)
            for call in (client.pause, client.spin_once, lambda: client.rig.levitate()):
                with pytest.raises(ClientError, match="in a call of another thread; allowed: one client per thread"):
                    call()
        finally:
            simulator.publish(5, 100)
            thread.join()
    assert ends == [RunEnd(5, 100, False)]
    assert simulator.pauses == 0


def test_a_call_from_a_callback_is_refused_before_anything_is_sent(graph: Graph, simulator: Simulator) -> None:
    refusals: list[str] = []

    def on_state(_: SimulatorState) -> None:
        try:
            client.pause()
        except ClientError as problem:
            refusals.append(str(problem))

    with client_of(graph) as client:
        client.node.create_subscription(SimulatorState, "/amb/simulator/state", on_state, EVERY_STATE)
        simulator.publish(5, 0)
        client.wait_until(lambda: bool(refusals))
        assert "from a callback" in refusals[0]
        assert simulator.pauses == 0
        assert client.pause() == 7


def test_a_run_may_be_paused_by_its_own_progress(graph: Graph, simulator: Simulator) -> None:
    simulator.on_run = lambda: simulator.publish(5, 3, SimulatorState.RUNNING)
    with client_of(graph) as client:

        def pause(step: int) -> None:
            if step == 3:
                client.pause()
                simulator.publish(5, 3)

        with pytest.raises(ClientError, match="paused at step 3, before 100"):
            client.run(100, pause)
    assert simulator.pauses == 1
