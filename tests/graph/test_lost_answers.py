"""Answers of services that get lost, as they do on a busy machine, and who makes up for it."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.action import ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.connection import GraphConnection
from amb_core.errors import ParameterError
from amb_core.recording import Recording
from amb_msgs.action import BuildMap
from amb_msgs.msg import LoopSamples, SimulatorState
from amb_msgs.srv import GetModel, StartRecording, StopRecording
from amb_ros import middleware
from amb_ros.qos import HISTORY
from amb_ros.remote_parameters import RemoteParameters
from tests.graph.limits import TIMEOUT

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
        assert client.act(BuildMap, "region_monitor/build_map", BuildMap.Goal(), lambda _: None, lambda: False).success
        graph.wait_until(lambda: "amb_client" in graph.node.get_node_names(), "the client")
    graph.wait_until(lambda: "amb_client" not in graph.node.get_node_names(), "the end of the client", timeout=30.0)
    server.destroy()


@pytest.mark.slow
def test_a_service_waits_for_a_client_that_is_not_matched_yet(graph: Graph) -> None:
    """By its quality of service this client is never matched, so the service waits as long as it is told to."""
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
