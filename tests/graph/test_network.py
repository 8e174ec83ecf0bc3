"""Who can reach the nodes: by default this host only, discovery and sockets alike."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess

import pytest

from amb_msgs.srv import StopRecording
from amb_ros import middleware, network
from tests.graph.conftest import Graph


def start_recorder(graph: Graph, **environment: str) -> int:
    """Start a recorder by the command line, and wait until it answers; its process."""
    for name in (network.RANGE, middleware.VARIABLE):
        graph.environment.pop(name, None)
    graph.environment |= environment
    process = graph.start_command(["amb", "run", "amb_ident_node", "recorder"])
    answer = graph.call(StopRecording, "/amb/recorder/stop")
    assert "nothing is being recorded" in answer.message
    return process.pid


def test_a_node_of_this_host_takes_no_packets_from_a_network(graph: Graph) -> None:
    pid = start_recorder(graph)
    assert network.sockets_open_to_network(graph.domain, pid) == []


@pytest.mark.parametrize("only", ["", "0"])
def test_an_explicit_range_holds_where_localhost_only_is_off(graph: Graph, only: str) -> None:
    pid = start_recorder(graph, ROS_LOCALHOST_ONLY=only, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    assert network.sockets_open_to_network(graph.domain, pid) == []


def test_a_node_of_the_network_is_reached_from_this_host_too(graph: Graph) -> None:
    pid = start_recorder(graph, ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET")
    assert network.sockets_open_to_network(graph.domain, pid), "otherwise the test above could not fail"


@pytest.mark.parametrize(("offsets", "seen"), [((12,), []), ((13, 14), []), ((12, 13), [12, 13]), ((0, 1), [])])
def test_a_socket_counts_only_if_a_participant_receives_there(offsets, seen) -> None:
    first = network.PORT_BASE + network.DOMAIN_GAIN * 215  # above the ports that a system gives away
    with contextlib.ExitStack() as stack:
        for offset in offsets:
            one = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            one.bind(("0.0.0.0", first + offset))
        assert network.sockets_open_to_network(215) == [f"0.0.0.0:{first + offset}" for offset in seen]


@pytest.mark.parametrize(
    ("environment", "local"),
    [
        ({}, True),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, False),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, True),
        ({"ROS_STATIC_PEERS": "192.0.2.7"}, False),
        ({"ROS_LOCALHOST_ONLY": "1"}, True),
        ({"ROS_LOCALHOST_ONLY": "0"}, False),
        ({"ROS_LOCALHOST_ONLY": ""}, True),
        ({"ROS_LOCALHOST_ONLY": "0", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, True),
    ],
)
def test_the_command_line_keeps_to_this_host_unless_the_environment_says_more(environment, local, monkeypatch) -> None:
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    network.keep_to_this_host()
    assert network.is_local() == local


def test_amb_up_warns_when_it_opens_the_graph_to_the_network(graph: Graph) -> None:
    environment = {
        name: value for name, value in os.environ.items() if name not in (network.RANGE, middleware.VARIABLE)
    }
    environment |= {"ROS_DOMAIN_ID": str(graph.domain), "ROS_LOG_DIR": str(graph.folder)}
    command = ["amb", "up", "--network", "--controller", "pd_controller"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as up:
        assert up.stdout is not None
        warning = up.stdout.readline()
        up.terminate()
        up.communicate()
    assert "other hosts of the network can reach the nodes" in warning
