"""The end of a node: by a signal at any moment, also while it starts, and with its stacks where it hangs."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from amb_bringup.graph.launch_file import NodeProcess as Launched
from amb_bringup.graph.launcher import Graph as Launcher
from amb_ros import shared_memory
from amb_ros.interruptions import SIGNALS
from amb_ros.leaving import leave_graph
from tests.delayed_discovery import build_delayed_discovery, delays
from tests.graph.limits import TIMEOUT
from tests.graph.processes import SHARED_MEMORY

if TYPE_CHECKING:
    from tests.graph.conftest import Graph
    from tests.graph.processes import NodeProcess

NODES = (
    "amb_sim_node.simulator",
    "amb_controller_node.pd_controller",
    "amb_controller_node.excitation_generator",
    "amb_ident_node.identifier",
    "amb_ident_node.recorder",
    "amb_ident_node.region_monitor",
)
HANGING = """
import faulthandler, signal, time
faulthandler.register(signal.SIGUSR1)
signal.signal(signal.SIGINT, signal.SIG_IGN)
def wait_for_ever():
    print("ready", flush=True)
    time.sleep(1e6)
wait_for_ever()
"""

ASKING = """
from rclpy.node import Node
from std_srvs.srv import Trigger
from amb_ros.process import run_node
def make():
    node = Node("asking")
    node.client = node.create_client(Trigger, "/silent")
    node.client.wait_for_service()
    node.asked = node.client.call_async(Trigger.Request())
    return node
raise SystemExit(run_node(make))
"""

WITH_FAULT = "from amb_ros import overflowed_wait; overflowed_wait.correct = lambda: None"
LEAVING = """
from pathlib import Path
from rclpy.node import Node
from amb_ros.process import run_node
class Leaving(Node):
    def __init__(self):
        super().__init__("leaving", start_parameter_services=False)
    def finish(self):
        Path("finished").touch()
raise SystemExit(run_node(Leaving))
"""
CRASHING = """
import ctypes, os
from pathlib import Path
from rclpy.node import Node
from amb_ros.process import run_node
class Crashing(Node):
    def __init__(self):
        super().__init__("crashing", start_parameter_services=False)
    def finish(self):
        Path("finished").touch()
    def destroy_node(self):
        {fault}
raise SystemExit(run_node(Crashing))
"""
HELD = """
from rclpy.node import Node
from amb_ros.process import run_node
class Held(Node):
    def __init__(self):
        super().__init__("held", start_parameter_services=False)
        self.handle.__enter__()  # as a thread does that uses the node at this moment
raise SystemExit(run_node(Held))
"""
ENDING_AT_ONCE = """
import os, signal
import rclpy
rclpy.init()
node = rclpy.create_node("ending_at_once")
signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
print("ready", flush=True)
while True:
    signal.pause()
"""
GOING_ON = """
import sys
from amb_bringup.client.connection import GraphConnection
connection = GraphConnection("", 10.0, None, ())
sys.stdin.readline()
connection.close()
sys.exit(3)
"""


def handles_signals(process: NodeProcess) -> bool:
    """Whether it has got as far as to end by itself on the last of the signals."""
    return is_among(SIGNALS[-1], "SigCgt", process)


def is_among(number: signal.Signals, signals: str, process: NodeProcess) -> bool:
    """Whether a process catches (SigCgt) or ignores (SigIgn) a signal."""
    (mask,) = (line for line in Path(f"/proc/{process.pid}/status").read_text().splitlines() if signals in line)
    return bool(int(mask.split()[1], 16) & 1 << (number - 1))


def makes_its_node(process: NodeProcess) -> bool:
    """Whether it has a participant, the first part of a node: its threads have names."""
    names = (task.read_text() for task in Path(f"/proc/{process.pid}/task").glob("*/comm"))
    return any(name.startswith("dds.") for name in names)


def test_a_signal_while_a_node_starts_ends_it(graph: Graph) -> None:
    moments = itertools.cycle(itertools.product([makes_its_node, handles_signals], SIGNALS))
    processes = {module: graph.start(module, anew=True) for module in NODES}
    waiting = [(process, *moment) for process, moment in zip(processes.values(), moments, strict=False)]

    def all_signalled() -> bool:
        for item in list(waiting):
            process, reached, by = item
            if reached(process):
                process.send_signal(by)
                waiting.remove(item)
        return not waiting

    graph.wait_until(all_signalled, "the start of all nodes")
    for process in processes.values():
        process.wait_for_end(TIMEOUT)
    ends = {module: (process.returncode, process.said) for module, process in processes.items()}
    assert ends == dict.fromkeys(processes, (0, ""))


def test_a_node_under_nohup_goes_on_when_its_terminal_is_closed(graph: Graph) -> None:
    process = graph.start_command(["nohup", sys.executable, "-c", LEAVING])
    graph.wait_until(lambda: "leaving" in graph.node.get_node_names(), "the node")
    assert is_among(signal.SIGHUP, "SigIgn", process)
    assert graph.stop(process)[0] == 0


def test_a_process_that_does_not_end_shows_where_it_hangs(graph: Graph) -> None:
    process = graph.start_command([sys.executable, "-c", HANGING], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    with pytest.raises(AssertionError, match="did not end within") as caught:
        process.wait_for_end(0.2)
    assert "wait_for_ever" in str(caught.value)
    assert process.returncode == -signal.SIGKILL


@pytest.fixture(scope="module")
def delayed_discovery(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of a process that leaves the graph while it hears of an end point."""
    library = tmp_path_factory.mktemp("delayed") / "delayed_discovery.so"
    build_delayed_discovery(library)
    return delays(library, each=0.0, held=0.3, wait=TIMEOUT)


def run_to_its_end(graph: Graph, process: NodeProcess) -> None:
    """Wait until a process has ended, which meanwhile hears of new end points and of their ends."""

    def ended() -> bool:
        graph.node.destroy_publisher(graph.node.create_publisher(Empty, "passing", 1))
        return process.poll() is not None

    graph.wait_until(ended, "the end of the process")


def leave_while_others_come_and_go(graph: Graph, code: str, environment: dict[str, str]) -> NodeProcess:
    graph.environment |= environment
    process = graph.start_command([sys.executable, "-c", code], stdin=subprocess.PIPE)
    graph.wait_until(lambda: len(graph.node.get_node_names()) > 1, "the node")
    if code.endswith(LEAVING):
        process.send_signal(signal.SIGINT)
    assert process.stdin is not None
    process.stdin.close()
    run_to_its_end(graph, process)
    return process


def test_a_node_ends_although_it_hears_of_others_at_that_moment(
    graph: Graph, delayed_discovery: dict[str, str]
) -> None:
    process = leave_while_others_come_and_go(graph, LEAVING, delayed_discovery)
    assert (process.returncode, process.said) == (0, "")


def test_a_node_that_hangs_while_it_leaves_has_finished_and_ends_with_its_stacks(
    graph: Graph, delayed_discovery: dict[str, str]
) -> None:
    process = leave_while_others_come_and_go(graph, WITH_FAULT + LEAVING, delayed_discovery)
    assert process.returncode == 0
    assert "in destroy_node" in process.said
    assert (graph.folder / "finished").exists()


@pytest.mark.parametrize("fault", ["ctypes.string_at(0)", "os.abort()"], ids=["SIGSEGV", "SIGABRT"])
def test_a_node_whose_middleware_crashes_while_it_leaves_ends_as_one_that_hangs_there(graph: Graph, fault: str) -> None:
    process = graph.start_command([sys.executable, "-c", CRASHING.format(fault=fault)])
    graph.wait_until(lambda: "crashing" in graph.node.get_node_names(), "the node")
    assert graph.stop(process)[0] == 0
    assert "in destroy_node" in process.said
    assert (graph.folder / "finished").exists()


@pytest.mark.parametrize("fault", ["", WITH_FAULT], ids=["corrected", "with the fault"])
def test_a_process_of_a_user_closes_its_connection_and_goes_on(
    graph: Graph, delayed_discovery: dict[str, str], fault: str
) -> None:
    process = leave_while_others_come_and_go(graph, fault + GOING_ON, delayed_discovery)
    assert process.returncode == 3
    assert ("this process goes on" in process.said) == bool(fault)


def test_what_a_node_holds_with_the_help_of_others_it_lets_go_before_the_graph_is_left(domain: int) -> None:
    """Such as a rotor whose loop a controller node closes."""

    class Bridge(Node):
        def let_go(self) -> None:
            letting_go.append(self.context.ok())

    letting_go: list[bool] = []
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node, executor = Bridge("bridge", context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    leave_graph(context, executor, [node])
    assert letting_go == [True]


def test_a_node_that_waits_for_an_answer_leaves_the_graph_before_it_ends(graph: Graph) -> None:
    asked = threading.Event()

    def keep_silent(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        asked.set()
        released.wait(TIMEOUT)
        return response

    released = threading.Event()
    graph.node.create_service(Trigger, "/silent", keep_silent)
    others = {path.name for path in SHARED_MEMORY.iterdir()}  # which it opens, too
    process = graph.start_command([sys.executable, "-c", ASKING])
    assert asked.wait(TIMEOUT)
    segments = process.open_segments() - others
    assert graph.stop(process) == (0, "")
    released.set()
    assert segments
    assert not [name for name in segments if (SHARED_MEMORY / name).exists()]


def test_a_killed_node_leaves_no_segment_behind(open_graph: Callable[[Path], Any], tmp_path: Path) -> None:
    with open_graph(tmp_path) as graph:
        process = graph.start("amb_controller_node.pd_controller")
        graph.wait_until(lambda: graph.node.count_publishers("/amb/telemetry"), "the controller")
        graph.stop(process, signal.SIGKILL)
        assert process.segments
    assert not [name for name in process.segments if (SHARED_MEMORY / name).exists()]


def test_a_node_that_a_thread_still_uses_leaves_no_segment_behind(graph: Graph) -> None:
    others = {path.name for path in SHARED_MEMORY.iterdir()}
    process = graph.start_command([sys.executable, "-c", HELD])
    graph.wait_until(lambda: "held" in graph.node.get_node_names(), "the node")
    segments = process.open_segments() - others
    assert graph.stop(process) == (0, "")
    assert segments
    assert not [name for name in segments if (SHARED_MEMORY / name).exists()]


def test_a_launched_node_that_ends_at_once_leaves_nothing_in_shared_memory(domain: int) -> None:
    ready = threading.Event()
    node = Launched("ending_at_once", (sys.executable, "-c", ENDING_AT_ONCE), {})
    with Launcher([node], {"ROS_DOMAIN_ID": str(domain)}, lambda *_: ready.set()) as launcher:
        assert ready.wait(TIMEOUT)
        files = shared_memory.owned(launcher.processes["ending_at_once"].pid)
        assert len(files) > 1, "a segment and ports"
    left = {path for path in files if path.exists()}
    assert not left - shared_memory.open_elsewhere(), "a port that a process of another test uses may stay"
