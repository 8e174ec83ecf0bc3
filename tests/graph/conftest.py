"""Graph tests: nodes as processes of their own, talking over DDS in a domain of their own."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

import pytest
import rclpy
import yaml
from domain_coordinator import domain_id
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from amb_ros import middleware
from amb_ros.leaving import leave_graph
from tests.graph.bearing import Bearing
from tests.graph.limits import TEST_TIMEOUT, TIMEOUT
from tests.graph.processes import ForkedNode, NodeProcess, Program, remove_shared_memory
from tests.graph.zygote import CHECK_FIELDS, zygote

T = TypeVar("T")
Opened = contextlib.AbstractContextManager

# Here, since both hold for the first participant of the process and all after it.
middleware.configure()
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # tests on two machines of one network do not meet

FAILED = pytest.StashKey[bool]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give tests of graphs their own limit."""
    for item in items:
        if item.path.parent == Path(__file__).parent and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(TEST_TIMEOUT))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Note at the test that it failed, for the fixtures that it used."""
    report = yield
    item.stash[FAILED] = item.stash.get(FAILED, False) or report.failed
    return report


class Graph:
    """Processes under test, and nodes of the test itself, in one DDS domain.

    Nodes of the test spin in a thread: what they receive arrives while the test waits in `wait_until` or `call`.
    """

    def __init__(self, domain: int, folder: Path) -> None:
        self.domain = domain
        self.folder = folder
        self.environment = os.environ | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_LOG_DIR": str(folder / "log"),
            # Users run without the checks: ROS_PYTHON_CHECK_FIELDS=0 python -m pytest tests/graph does so too.
            CHECK_FIELDS: os.environ.get(CHECK_FIELDS, "1"),
        }
        self._processes: list[NodeProcess] = []
        self._modules: dict[str, NodeProcess] = {}  # those that are meant to run
        self._nodes: list[Node] = []
        self._clients: dict[str, Client] = {}
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._executor = EventsExecutor(context=self._context)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        self.node = self.add_node("graph_test")

    def start(
        self,
        module: str,
        *arguments: str,
        parameters: Mapping[str, Any] | None = None,
        anew: bool = False,
        **options: Any,
    ) -> NodeProcess:
        """Start the node of a module, such as `amb_ident_node.recorder`, as a process.

        `arguments` follow `--ros-args`. A node that is started `anew`, with options of Popen, or with libraries to
        preload, is a new interpreter that has the imports before it; others are forks of a process that has imported
        them. A second process of a module beside one that runs is a rival, which `process_of` does not return.
        """
        args = [module, "--ros-args", *arguments]
        if parameters:
            file = self.folder / f"parameters_{len(self._processes)}.yaml"
            file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}))
            args += ["--params-file", str(file)]
        if anew or options or "LD_PRELOAD" in self.environment:
            process: NodeProcess = self.start_command([sys.executable, "-m", *args], **options)
        else:
            forking = zygote(self.environment[CHECK_FIELDS])
            process = ForkedNode(forking, args, self._next_errors(), self.environment, self.folder)
            self._processes.append(process)
        running = self._modules.get(module)
        if running is None or running.poll() is not None:
            self._modules[module] = process
        return process

    def start_command(self, command: list[str], **options: Any) -> Program:
        """Start any program as a process of the graph; `options` go to Popen."""
        process = Program(command, self._next_errors(), env=self.environment, cwd=self.folder, **options)
        self._processes.append(process)
        return process

    def _next_errors(self) -> Path:
        return self.folder / f"stderr_{len(self._processes)}.txt"

    def process_of(self, module: str) -> NodeProcess:
        """The process in which a module was started last."""
        return self._modules[module]

    def stop(self, process: NodeProcess, by: signal.Signals = signal.SIGINT) -> tuple[int, str]:
        """End a process by a signal; its exit code and what it wrote to stderr."""
        self._modules = {module: other for module, other in self._modules.items() if other is not process}
        process.send_signal(by)
        process.wait_for_end(TIMEOUT)
        return process.returncode, process.said

    def is_whole(self) -> bool:
        """Whether all modules that were started and not stopped still run."""
        return all(process.poll() is None for process in self._modules.values())

    def add_node(self, name: str, namespace: str = "", **options: Any) -> Node:
        """A node of the test itself."""
        node = Node(name, namespace=namespace, context=self._context, **options)
        self._executor.add_node(node)
        self._nodes.append(node)
        return node

    def call(self, service_type: Any, name: str, /, **fields: Any) -> Any:
        """Call a service once it is there, with these fields in the request, and return its response."""
        return self.asked(service_type, name, **fields)()

    def asked(self, service_type: Any, name: str, /, **fields: Any) -> Callable[[], Any]:
        """Call a service once it is there; what is returned waits for its response."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service_type, name)
        client = self._clients[name]
        self.wait_until(client.service_is_ready, what=f"service {name}")
        future = client.call_async(service_type.Request(**fields))

        def answer() -> Any:
            self.wait_until(future.done, what=f"an answer of {name}")
            return future.result()

        return answer

    def send_goal(self, action: ActionClient, goal: Any, on_feedback: Callable[[Any], None]) -> ClientGoalHandle:
        """Send a goal to an action once it is there, and return its handle when it is accepted or rejected."""
        self.wait_until(action.server_is_ready, what="the action")
        sent = self._in_executor(action.send_goal_async, goal, on_feedback)
        self.wait_until(sent.done, what="the goal's acceptance")
        return sent.result()

    def result_of(self, handle: ClientGoalHandle) -> tuple[int, Any]:
        """Status and result of a goal."""
        ended = self._in_executor(handle.get_result_async)
        self.wait_until(ended.done, what="the result")
        return ended.result().status, ended.result().result

    def cancel(self, handle: ClientGoalHandle) -> None:
        """Ask for the end of a goal."""
        self._in_executor(handle.cancel_goal_async)

    def _in_executor(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in the thread that spins: an action client loses an answer that comes while it asks."""
        called = self._executor.create_task(function, *arguments)
        self.wait_until(called.done, what=function.__name__)
        return called.result()

    def wait_until(
        self, condition: Callable[[], object], what: str = "the condition", timeout: float = TIMEOUT
    ) -> None:
        """Wait until a condition holds, and fail if it does not in time."""
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not come within {timeout} s"
            time.sleep(0.005)

    def close(self) -> None:
        """End all processes and nodes, and fail if a process does not end."""
        ended = [process for process in self._processes if process.poll() is None]
        for process in ended:
            process.send_signal(signal.SIGINT)
        problems = []
        for process in self._processes:
            try:
                process.wait_for_end(TIMEOUT)
            except AssertionError as problem:
                problems.append(str(problem))
        for module, process in self._modules.items():
            if process in ended and process.returncode not in (0, -signal.SIGINT):  # by SIGINT while it was imported
                problems.append(f"{module} ended with exit code {process.returncode}\n{process.said}")
        self._context.try_shutdown()
        self._thread.join()
        leave_graph(self._context, self._executor, self._nodes)
        remove_shared_memory(self._processes)
        assert not problems, "\n".join(problems)

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while self._context.ok():
                self._executor.spin_once(timeout_sec=0.1)


# Going on, so that no graph meets what one before it left; two runs at the same time start at different ones.
_next_domain = itertools.islice(itertools.cycle(range(1, 101)), 37 * os.getpid() % 100, None).__next__


@contextlib.contextmanager
def _own_domain() -> Iterator[int]:
    with domain_id(_next_domain) as domain:
        yield domain


@contextlib.contextmanager
def opened_graph(folder: Path) -> Iterator[Graph]:
    """A graph whose processes run in a folder, for programs; tests use the fixtures."""
    with _own_domain() as domain:
        graph = Graph(domain, folder)
        try:
            yield graph
        finally:
            graph.close()


@pytest.fixture
def domain() -> Iterator[int]:
    """A DDS domain that no other test uses, in this run or in another on this machine."""
    with _own_domain() as domain:
        yield domain


@pytest.fixture(scope="session")
def own_domain() -> Callable[[], contextlib.AbstractContextManager[int]]:
    """Reserves such a domain, for fixtures that share one among tests."""
    return _own_domain


@pytest.fixture(scope="session")
def open_graph() -> Callable[[Path], contextlib.AbstractContextManager[Graph]]:
    """Opens a graph whose processes run in a folder, for fixtures that share one among tests."""
    return opened_graph


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A graph of its own for one test; its processes run in `tmp_path`."""
    with opened_graph(tmp_path) as graph:
        yield graph


class Shelf:
    """Keeps one thing open for the tests that can share it, and closes it before it opens another."""

    def __init__(self) -> None:
        self._stack = contextlib.ExitStack()
        self._key: object = None
        self._kept: Any = None

    def take(self, key: object, opened: Callable[[], Opened[T]], works: Callable[[T], bool]) -> T:
        """What is kept under this key, if it still works; otherwise a new one."""
        if key != self._key or not works(self._kept):
            self.clear()
            self._kept = self._stack.enter_context(opened())
            self._key = key
        kept: T = self._kept
        return kept

    def clear(self) -> None:
        """Close what is kept."""
        self._key = self._kept = None
        self._stack.close()


@pytest.fixture(scope="module")  # no nodes run beside the tests of another file
def _shelf() -> Iterator[Shelf]:
    shelf = Shelf()
    yield shelf
    shelf.clear()


@pytest.fixture
def keep(_shelf: Shelf, request: pytest.FixtureRequest) -> Iterator[Callable[..., Any]]:
    """Shares what takes long to open: `keep(key, opened, works)` as in `Shelf.take`.

    After a failed test it is closed, so that no failure is passed on to the next one.
    """
    yield _shelf.take
    if request.node.stash.get(FAILED, False):
        _shelf.clear()


@pytest.fixture
def share(keep: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """Shares a graph: `share(make)` returns what `make(graph)` returned, for this test or for one before it.

    When a process of the graph has died or `works(made)` is False, it is made anew.
    """

    def take(make: Callable[[Graph], T], works: Callable[[T], bool] = lambda _: True) -> T:
        @contextlib.contextmanager
        def opened() -> Iterator[tuple[Graph, T]]:
            with opened_graph(tmp_path_factory.mktemp("shared")) as graph:
                yield graph, make(graph)

        _, made = keep(make, opened, lambda kept: kept[0].is_whole() and works(kept[1]))
        return cast(T, made)

    return take


@pytest.fixture
def bearing(graph: Graph) -> Bearing:
    """The loop of the graph of one test."""
    return Bearing(graph)
