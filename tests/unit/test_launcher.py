"""Launch files are read as `ros2 launch` reads them, and the processes of a graph start, are watched and end together.

The nodes are small shell scripts in a made-up install folder: nothing here needs a running ROS graph.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from amb_bringup.graph.launch_file import NodeProcess, read_launch_file
from amb_bringup.graph.launcher import Graph, own_domain
from amb_bringup.graph.packages import LaunchError, find_executable

LAUNCH_FOLDER = Path(__file__).parents[2] / "src" / "amb_bringup" / "launch"
NODES = {
    "amb_sim_node": ["simulator"],
    "amb_controller_node": ["pd_controller", "excitation_generator"],
    "amb_ident_node": ["recorder", "region_monitor", "identifier"],
    "amb_bringup": ["composed_loop"],
}
POLITE = "trap 'echo bye; exit 0' TERM; echo ready $ROS_DOMAIN_ID; while true; do sleep 0.02; done"
STUBBORN = "trap '' TERM USR1; echo ready; while true; do sleep 0.02; done"

AddExecutable = Callable[[str, str, str], Path]
StartAmb = Callable[..., "subprocess.Popen[str]"]
WriteLaunchFile = Callable[[object], Path]


@pytest.fixture
def add_executable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AddExecutable:
    """Adds a shell script as executable of a package to an install folder that is the whole ament index."""
    prefix = tmp_path / "install"
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))

    def add(package: str, executable: str, script: str) -> Path:
        marker = prefix / "share/ament_index/resource_index/packages" / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
        path = prefix / "lib" / package / executable
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/bash\n{script}\n")
        path.chmod(0o755)
        return path

    return add


@pytest.fixture
def bench(add_executable: AddExecutable) -> Path:
    """All executables of the workbench, polite; returns the folder of the launch and parameter files of amb_bringup."""
    for package, executables in NODES.items():
        for executable in executables:
            path = add_executable(package, executable, POLITE)
    share = path.parents[2] / "share" / "amb_bringup"
    (share / "config").mkdir(parents=True)
    (share / "config" / "paper.yaml").write_text("{}")
    (share / "launch").symlink_to(LAUNCH_FOLDER)
    return share


@pytest.fixture
def write(tmp_path: Path, add_executable: AddExecutable) -> WriteLaunchFile:
    """Writes a launch file with the given content, next to a package `pkg` with an executable `exe`."""
    add_executable("pkg", "exe", POLITE)

    def write_file(content: object) -> Path:
        path = tmp_path / "test.launch.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return write_file


def node(**extra: object) -> dict[str, object]:
    return {"node": {"pkg": "pkg", "exec": "exe", **extra}}


@pytest.mark.parametrize(
    ("file", "names"),
    [
        ("bearing", ["simulator", "pd_controller", "excitation_generator", "recorder", "region_monitor", "identifier"]),
        ("composed", ["composed_loop", "excitation_generator", "recorder", "region_monitor", "identifier"]),
    ],
)
def test_shipped_launch_files_describe_the_whole_graph(bench: Path, file: str, names: list[str]) -> None:
    nodes = read_launch_file(LAUNCH_FOLDER / f"{file}.launch.yaml")
    assert [n.name for n in nodes] == names
    assert all(n.command[-2:] == ("--params-file", str(bench / "config" / "paper.yaml")) for n in nodes)
    assert all("__ns:=/amb" in n.command for n in nodes)


def test_composed_loop_gets_no_node_name_as_it_would_rename_both_nodes(bench: Path) -> None:
    composed = read_launch_file(LAUNCH_FOLDER / "composed.launch.yaml")[0]
    assert not any("__node" in word for word in composed.command)


def test_launch_argument_replaces_its_default(bench: Path, tmp_path: Path) -> None:
    params = tmp_path / "mine.yaml"
    params.write_text("{}")
    nodes = read_launch_file(LAUNCH_FOLDER / "bearing.launch.yaml", {"params": str(params)})
    assert all(n.command[-1] == str(params) for n in nodes)


def test_node_becomes_the_command_line_that_ros2_launch_makes(
    write: WriteLaunchFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOPIC", "position")
    path = write(
        {
            "launch": [
                {"arg": {"name": "rate", "default": "10000.0"}},
                node(
                    name="me",
                    namespace="/amb",
                    args="--flag 'two words'",
                    param=[{"name": "rate", "value": "$(var rate)"}, {"name": "list", "value": [1.5, 2.0]}],
                    remap=[{"from": "a", "to": "$(env TOPIC)/$(env NOT_SET raw)"}],
                    env=[{"name": "KEY", "value": "word"}],
                ),
            ]
        }
    )
    (process,) = read_launch_file(path)
    assert process.name == "me"
    assert process.env == {"KEY": "word"}
    assert list(process.command) == [
        str(find_executable("pkg", "exe")),
        *("--flag", "two words", "--ros-args", "-r", "__node:=me", "-r", "__ns:=/amb"),
        *("-p", "rate:=10000.0", "-p", "list:=[1.5, 2.0]", "-r", "a:=position/raw"),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "single key 'launch'"),
        ({"launch": [{"include": {"file": "x"}}]}, r"entry 1 \(include\) is not supported here; supported: arg, node"),
        ({"launch": [node(respawn=True)]}, "'respawn' is not supported here; supported: pkg, exec"),
        ({"launch": [node(output="log")]}, "output 'log' is not supported"),
        ({"launch": [node(name="$(command date)")]}, r"'\$\(command date\)' is not supported here"),
        ({"launch": [node(name="$(var $(var x))")]}, "nested or open substitutions"),
        ({"launch": [node(name="$(var late)"), {"arg": {"name": "late"}}]}, "no argument of this name"),
        ({"launch": [node(name=3)]}, "'name' = 3 must be a text"),
        ({"launch": [node(param={"from": "x"})]}, "'param' must be a list of mappings"),
        ({"launch": [node(param=[{"name": "x"}])]}, "needs either 'from', or 'name' and 'value'; it has name"),
        ({"launch": [node(param=[{"from": "/no/such.yaml"}])]}, "parameter file '/no/such.yaml' does not exist"),
        ({"launch": [node(), node()]}, "two nodes are named 'exe'"),
        ({"launch": [{"arg": {"name": "needed"}}]}, "argument 'needed' needs a value"),
        ({"launch": [{"node": {"pkg": "pkg", "exec": "no"}}]}, "has no executable 'no'; it has: exe"),
        ({"launch": [{"node": {"pkg": "no", "exec": "exe"}}]}, "package 'no' is not found"),
    ],
)
def test_what_cannot_be_launched_is_refused_by_name(write: WriteLaunchFile, content: object, message: str) -> None:
    path = write(content)
    with pytest.raises(LaunchError, match=message) as caught:
        read_launch_file(path)
    assert str(path) in str(caught.value)


def test_unknown_argument_is_refused_with_the_known_ones(bench: Path) -> None:
    with pytest.raises(LaunchError, match="unknown argument 'param'; known: params"):
        read_launch_file(LAUNCH_FOLDER / "bearing.launch.yaml", {"param": "x"})


def test_missing_launch_file_is_named() -> None:
    with pytest.raises(LaunchError, match=r"/no/such\.launch\.yaml: cannot be read"):
        read_launch_file("/no/such.launch.yaml")


def wait_for_line(graph: Graph, name: str, text: str) -> None:
    deadline = time.monotonic() + 60.0
    while not any(text in line for line in graph.lines(name)):
        assert time.monotonic() < deadline, f"{name} did not say '{text}'"
        time.sleep(0.01)


def shell(name: str, script: str, **env: str) -> NodeProcess:
    return NodeProcess(name, ("bash", "-c", script), env)


def test_graph_forwards_output_with_names_and_stops_with_sigterm() -> None:
    said: list[tuple[str, str]] = []
    with Graph(
        [shell("a", POLITE), shell("b", POLITE)], {"ROS_DOMAIN_ID": "42"}, lambda name, text: said.append((name, text))
    ) as graph:
        for name in ("a", "b"):
            wait_for_line(graph, name, "ready 42")
        graph.check()
    assert graph.ended() == {"a": 0, "b": 0}
    assert {("a", "ready 42"), ("b", "ready 42"), ("a", "bye"), ("b", "bye")} == set(said)


def test_node_that_ignores_sigterm_is_ended_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    stages = ((signal.SIGTERM, 0.3), (signal.SIGKILL, 5.0))
    monkeypatch.setattr("amb_bringup.graph.launcher.STOP_STAGES", stages)
    with Graph([shell("stubborn", STUBBORN)]) as graph:
        wait_for_line(graph, "stubborn", "ready")
    assert graph.ended() == {"stubborn": -signal.SIGKILL}


def test_dead_node_is_named_with_its_exit_code_and_last_words() -> None:
    with Graph([shell("good", POLITE), shell("bad", "echo parameter out of range >&2; exit 3")]) as graph:
        assert graph.wait(60.0) == {"bad": 3}
        with pytest.raises(
            LaunchError, match="node bad ended with exit code 3; its last output: parameter out of range"
        ):
            graph.check()


def test_killed_node_can_be_started_again() -> None:
    with Graph([shell("node", POLITE)]) as graph:
        wait_for_line(graph, "node", "ready")
        graph.processes["node"].kill()
        assert graph.wait(60.0) == {"node": -signal.SIGKILL}
        graph.start_node("node")
        assert graph.wait(0.2) == {}


def test_node_that_cannot_be_started_takes_no_other_along() -> None:
    graph = Graph([shell("good", POLITE), NodeProcess("bad", ("/no/such/executable",))])
    with pytest.raises(LaunchError, match="node 'bad' cannot be started"):
        graph.start()
    assert list(graph.ended()) == ["good"]


@pytest.fixture
def amb() -> Iterator[StartAmb]:
    """Starts the command line; what a failed test leaves running is ended, nodes included."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", "import sys; from amb_bringup.cli import main; sys.exit(main())", *arguments]
        environment = os.environ | {"ROS_DOMAIN_ID": "42"}
        started.append(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment)
        )
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            process.terminate()
            process.communicate(timeout=60.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_amb_up_shows_all_nodes_and_ends_cleanly(bench: Path, amb: StartAmb, number: signal.Signals) -> None:
    process = amb("up")
    assert process.stdout is not None
    expected = {f"[{name}] ready 42" for names in NODES.values() for name in names if name != "composed_loop"}
    assert {process.stdout.readline().strip() for _ in expected} == expected
    process.send_signal(number)
    rest, _ = process.communicate(timeout=60.0)
    assert rest.count("bye") == len(expected)
    assert process.returncode == 0


def test_amb_up_ends_with_an_error_that_names_the_dead_node(
    bench: Path, amb: StartAmb, add_executable: AddExecutable
) -> None:
    add_executable("amb_ident_node", "recorder", "sleep 0.3; exit 4")
    process = amb("up", "--composed")
    said, _ = process.communicate(timeout=60.0)
    assert "amb: node recorder ended with exit code 4" in said
    assert process.returncode == 1


def test_amb_run_becomes_the_executable_and_passes_everything_on(amb: StartAmb, add_executable: AddExecutable) -> None:
    add_executable("pkg", "exe", 'echo "$@"; exit 5')
    process = amb("run", "pkg", "exe", "--help", "--ros-args", "-p", "x:=1")
    said, _ = process.communicate(timeout=60.0)
    assert said.strip() == "--help --ros-args -p x:=1"
    assert process.returncode == 5


def test_amb_run_names_the_executables_there_are(amb: StartAmb, add_executable: AddExecutable) -> None:
    add_executable("pkg", "exe", "true")
    process = amb("run", "pkg", "typo")
    said, _ = process.communicate(timeout=60.0)
    assert said.strip() == "amb: package 'pkg' has no executable 'typo'; it has: exe"
    assert process.returncode == 1


def test_an_impatient_second_ctrl_c_leaves_no_node_behind() -> None:
    def interrupt(_name: str, text: str) -> None:
        if text == "no":
            os.kill(os.getpid(), signal.SIGINT)

    stubborn = STUBBORN.replace("''", "'echo no'", 1)
    with Graph([shell("stubborn", stubborn)], output=interrupt) as graph:
        wait_for_line(graph, "stubborn", "ready")
        assert graph.stop() == {"stubborn": -signal.SIGKILL}


def test_amb_up_refuses_a_wrong_parameter_file_before_it_starts_anything(
    bench: Path, amb: StartAmb, tmp_path: Path
) -> None:
    file = tmp_path / "flat.yaml"
    file.write_text("rotor.mass: 5.0\n")
    process = amb("up", "--params", str(file))
    said, _ = process.communicate(timeout=30.0)
    assert said.strip() == (
        f"amb: parameter file {file}: each entry must be a node name with a mapping 'ros__parameters'; "
        "'rotor.mass' is not"
    )
    assert process.returncode == 1


def test_two_sessions_get_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    other = "from amb_bringup.graph.launcher import own_domain; print(own_domain())"
    own = own_domain()
    given = int(subprocess.run([sys.executable, "-c", other], capture_output=True, text=True, check=True).stdout)
    assert own_domain() == own != given
    monkeypatch.setenv("ROS_DOMAIN_ID", "77")
    assert own_domain() == 77


@pytest.mark.parametrize("given", ["abc", "-1", "233", "7.0"])
def test_a_domain_that_is_none_is_refused_with_what_is_allowed(monkeypatch: pytest.MonkeyPatch, given: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", given)
    with pytest.raises(LaunchError, match=rf"'?ROS_DOMAIN_ID'? = '{given}' is not allowed; allowed: 0 to 232"):
        own_domain()
