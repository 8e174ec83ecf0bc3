"""Answers of services that get lost, as they do on a busy machine, and who makes up for it."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.action import ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.connection import GraphConnection
from amb_bringup.client.experiment import SimulatorStand
from amb_core.ground.errors import ParameterError
from amb_core.recording import Recording
from amb_msgs.action import BuildMap
from amb_msgs.msg import LoopSamples, SimulatorState
from amb_msgs.srv import GetModel, StartExcitation, StartRecording, StopExcitation, StopRecording
from amb_ros import middleware
from amb_ros.qos import HISTORY
from amb_ros.remote_parameters import RemoteParameters
from tests.graph.limits import TIMEOUT
from tests.graph.processes import segments_of

if TYPE_CHECKING:
    from rclpy.action.server import ServerGoalHandle
    from rclpy.node import Node

    from tests.graph.conftest import Graph


def forgetful_node(graph: Graph, lost: int) -> tuple[Node, list[list[Any]]]:
    """A node whose first answers about its parameters get lost, each as often; and what it answers by service."""
    node = graph.add_node("forgetful", "/amb", start_parameter_services=False)

    def names(_: Any, response: Any) -> Any:
        response.result.names = ["gain"]
        return response

    def values(_: Any, response: Any) -> Any:
        response.values = [graph.node.get_parameter("use_sim_time").get_parameter_value()]
        return response

    answers = [
        _lose_answers(node.create_service(kind, f"~/{name}_parameters", callback), lost)
        for kind, name, callback in ((ListParameters, "list", names), (GetParameters, "get", values))
    ]
    return node, answers


def _lose_answers(service: Any, count: int) -> list[Any]:
    send, sent = service.send_response, []

    def send_later_ones(response: Any, header: Any) -> None:
        sent.append(response)
        if len(sent) > count:
            send(response, header)

    service.send_response = send_later_ones
    return sent


def test_parameters_are_asked_for_again(graph: Graph) -> None:
    _, answers = forgetful_node(graph, lost=1)
    remote = RemoteParameters(graph.node)
    assert remote.read("/amb/forgetful", TIMEOUT) == {"gain": False}
    assert min(map(len, answers)) >= 2, "neither answer came at once"
    assert remote.read("/amb/forgetful", TIMEOUT) == {"gain": False}


def test_a_bridge_is_asked_for_its_state_again(graph: Graph) -> None:
    def label(_: Any, response: Any) -> Any:
        response.current_state.label = "active"
        return response

    answers = _lose_answers(graph.node.create_service(GetState, "/amb/hardware_bridge/get_state", label), 1)
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as amb:
        assert amb.rig.life_cycle() == "active"
    assert len(answers) >= 2, "the first answer did not come"


def test_a_node_that_never_tells_its_parameters_is_named(graph: Graph) -> None:
    forgetful_node(graph, lost=1_000)
    with pytest.raises(ParameterError, match="node /amb/forgetful did not report its parameters"):
        RemoteParameters(graph.node).read("/amb/forgetful", 0.2)


def test_only_nodes_that_tell_their_parameters_are_asked(graph: Graph) -> None:
    reader = graph.add_node("reader", "/amb")
    graph.add_node("silent", "/amb", start_parameter_services=False)
    reader.create_client(ListParameters, "/amb/absent/list_parameters")  # makes no node
    forgetful_node(graph, lost=0)
    remote = RemoteParameters(reader)
    graph.wait_until(lambda: remote.nodes() == ["/amb/forgetful", "/amb/reader"], "the nodes")


def test_the_recorder_asks_until_the_bag_is_closed_and_says_which_parameters_are_missing(graph: Graph) -> None:
    node, _ = forgetful_node(graph, lost=1_000)
    for kind, topic in ((LoopSamples, "telemetry"), (SimulatorState, "simulator/state")):  # what a recorder waits for
        graph.node.create_publisher(kind, f"/amb/{topic}", HISTORY)
    graph.start("amb_ident_node.recorder", parameters={"parameter_timeout": 0.2})
    graph.wait_until(lambda: graph.node.count_subscribers("/amb/telemetry"), "the recorder")
    assert graph.call(StartRecording, "/amb/recorder/start", uri="lacking").success
    stopped = graph.call(StopRecording, "/amb/recorder/stop")
    assert not stopped.success
    assert stopped.message == "the parameters of /amb/forgetful are missing"
    bag = Recording.read(stopped.uri)
    assert not bag.truncated
    assert set(bag.parameters()) == {"/amb/recorder"}

    assert graph.call(StartRecording, "/amb/recorder/start", uri="complete").success
    for service in node.services:
        vars(service).pop("send_response", None)  # from now on its answers come through
    stopped = graph.call(StopRecording, "/amb/recorder/stop")
    assert stopped.success, stopped.message
    assert Recording.read(stopped.uri).parameters()["/amb/forgetful"] == {"gain": False}


def test_a_node_that_is_discovered_during_a_stop_is_in_the_bag(graph: Graph) -> None:
    node, answers = forgetful_node(graph, lost=1_000)
    graph.start("amb_ident_node.recorder", parameters={"parameter_timeout": 0.2})
    assert graph.call(StartRecording, "/amb/recorder/start", uri="bag").success
    stopped = graph.asked(StopRecording, "/amb/recorder/stop", timeout=0.5 * TIMEOUT)

    def wait_for_requests(count: int) -> None:
        enough = len(answers[0]) + count
        graph.wait_until(lambda: len(answers[0]) >= enough, "requests of the recorder")

    wait_for_requests(2)  # the first may have been sent before the stop
    late = graph.add_node("late", "/amb")
    graph.wait_until(lambda: "recorder" in late.get_node_names(), "the recorder")
    wait_for_requests(2)  # which gives it time to discover the node, too
    for service in node.services:
        vars(service).pop("send_response", None)
    answer = stopped()
    assert answer.success, answer.message
    assert set(Recording.read(answer.uri).parameters()) == {"/amb/forgetful", "/amb/late", "/amb/recorder"}


def test_a_client_leaves_the_graph_though_a_request_is_open(graph: Graph) -> None:
    _lose_answers(graph.node.create_service(GetModel, "/amb/identifier/get_model", lambda _, response: response), 1_000)
    for _ in range(3):
        with (
            AmbClient(domain_id=int(graph.environment["ROS_DOMAIN_ID"]), timeout=2.0) as client,
            pytest.raises(ClientError, match="no answer"),
        ):
            client.wait_until(lambda: client.node.count_services("/amb/identifier/get_model") > 0, timeout=TIMEOUT)
            client.get_model()
    graph.wait_until(lambda: "amb_client" not in graph.node.get_node_names(), "the end of the last client")


def test_a_client_that_has_used_an_action_leaves_the_graph_when_it_closes(graph: Graph) -> None:
    def succeed(goal: ServerGoalHandle) -> BuildMap.Result:
        goal.succeed()
        return BuildMap.Result(success=True)

    server = ActionServer(graph.node, BuildMap, "/amb/region_monitor/build_map", succeed)
    client = GraphConnection("amb", TIMEOUT, graph.domain, [])
    with client:
        assert client.act(BuildMap, "region_monitor/build_map", on_feedback=print, cancelled=lambda: False).success
        graph.wait_until(lambda: "amb_client" in graph.node.get_node_names(), "the client")
    graph.wait_until(lambda: "amb_client" not in graph.node.get_node_names(), "the end of the client", timeout=30.0)
    server.destroy()


@pytest.mark.slow
def test_a_service_waits_for_a_client_that_is_not_matched_yet(graph: Graph) -> None:
    """By its quality of service this client is never matched, so the service waits as long as its parameter demands."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    waited: list[float] = []
    service = graph.node.create_service(GetModel, "/half", lambda _, response: response)
    send = service.send_response

    def send_timed(response: Any, header: Any) -> None:
        began = clock.now()
        with pytest.warns(RuntimeWarning, match="client will not receive response"):
            send(response, header)
        waited.append(1e-9 * (clock.now() - began).nanoseconds)

    service.send_response = send_timed
    client = graph.node.create_client(
        GetModel, "/half", qos_profile=QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )

    def asked() -> bool:  # until the service has heard of the client's requests, which are lost
        client.call_async(GetModel.Request())
        time.sleep(0.1)
        return bool(waited)

    graph.wait_until(asked, "the end of the wait")
    assert waited[0] >= 2.9, "at least as long as the profile says"


def test_settings_of_the_user_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(middleware.VARIABLE, "mine.xml")
    middleware.configure()
    assert os.environ[middleware.VARIABLE] == "mine.xml"
    monkeypatch.delenv(middleware.VARIABLE)
    middleware.configure()
    assert os.environ[middleware.VARIABLE] == str(middleware.LOCAL_PROFILES)  # tests keep to this host


def test_a_node_that_was_killed_and_started_again_answers_clients_that_knew_the_former_one(graph: Graph) -> None:
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as client:
        ours = segments_of(os.getpid())  # the client's and the test's, to which either process may have written
        segments: list[set[str]] = []
        for _ in range(2):
            process = graph.start("amb_controller_node.excitation_generator", parameters={"answer_timeout": 0.1})
            with pytest.raises(ClientError, match="with the current run"):  # its answer: there is no simulator
                client.stop_excitation()
            segments.append(process.open_segments())
            graph.stop(process, signal.SIGKILL)
            for name in segments[-1]:
                lock = Path("/dev/shm", f"{name}_el")
                if lock.exists():
                    os.utime(lock, (0.0, 0.0))  # as if it had been left long ago
    left = {path.name for path in Path("/dev/shm").iterdir()}
    own = segments[0] - segments[1] - ours
    assert own
    assert not own & left, "the second process has removed what the first one left"


ENDLESS = """
import sys, threading
import rclpy
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor
from amb_msgs.action import BuildMap
rclpy.init()
node = rclpy.create_node("region_monitor", namespace="amb")
server = ActionServer(node, BuildMap, "region_monitor/build_map", lambda goal: threading.Event().wait())
executor = MultiThreadedExecutor(2)
executor.add_node(node)
executor.spin()
"""


def test_a_goal_of_a_node_that_was_killed_and_started_again_ends_with_an_error(graph: Graph) -> None:
    command = [sys.executable, "-c", ENDLESS]
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as client:
        processes = [graph.start_command(command)]

        def kill_and_start() -> bool:
            if len(processes) == 1:
                graph.stop(processes[0], signal.SIGKILL)
                processes.append(graph.start_command(command))
            return False

        with pytest.raises(ClientError, match=r"started again, and does not know the goal|its node has ended"):
            client.build_map(cancelled=kill_and_start)
        graph.stop(processes[1], signal.SIGKILL)


def test_a_request_that_is_sent_once_says_so_when_it_is_not_answered(graph: Graph) -> None:
    asked = _lose_answers(graph.node.create_service(StartRecording, "/amb/recorder/start", lambda _, answer: answer), 9)
    with AmbClient(domain_id=graph.domain, timeout=1.0, nodes=()) as client:
        client.wait_until(lambda: client.node.count_services("/amb/recorder/start") > 0, timeout=TIMEOUT)
        with pytest.raises(ClientError, match="it may have been carried out"):
            client.start_recording()
    assert len(asked) == 1


def test_an_excitation_without_an_answer_is_stopped(graph: Graph, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("amb_bringup.client.loop_calls.EXCITATION_TIMEOUT", 0.5)

    def stop(_: Any, response: Any) -> Any:
        stopped.append(True)
        response.success = True
        return response

    stopped: list[bool] = []
    node = graph.node
    _lose_answers(node.create_service(StartExcitation, "/amb/excitation_generator/start", lambda _, answer: answer), 9)
    node.create_service(StopExcitation, "/amb/excitation_generator/stop", stop)
    with AmbClient(domain_id=graph.domain, timeout=2.0) as client:
        client.wait_until(lambda: node.count_services("/amb/excitation_generator/stop") > 0, timeout=TIMEOUT)
        with pytest.raises(ClientError, match="no answer from /amb/excitation_generator/start"):
            client.start_excitation("square", amplitude=1e-6, duration=0.1)
    assert stopped


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("", ""),
        ("nothing is being recorded", r"no answer from /amb/recorder/stop .*; then: .*nothing is being recorded"),
    ],
    ids=["an open bag", "a closed bag"],
)
def test_a_recorder_that_does_not_answer_is_asked_once_more_to_close_the_bag(
    graph: Graph, second: str, said: str
) -> None:
    def stop(_: Any, response: Any) -> Any:
        response.success, response.message = not second, second
        return response

    asked = _lose_answers(graph.node.create_service(StopRecording, "/amb/recorder/stop", stop), 1)
    with AmbClient(domain_id=graph.domain, timeout=1.0, nodes=()) as client:
        client.wait_until(lambda: client.node.count_services("/amb/recorder/stop") > 0, timeout=TIMEOUT)
        with pytest.raises(ClientError, match=said) if said else contextlib.nullcontext():
            SimulatorStand(client, lambda *_: None).close_recording(1, 100)
    assert len(asked) == 2
