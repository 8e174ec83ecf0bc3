"""Experiments from start to end: one command, and the same from Python; the rotor is landed whatever happens."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from amb_bringup.client import AmbClient, ClientError, Experiment
from amb_bringup.client.experiment import RigStand, SimulatorStand, running_stand
from amb_bringup.experiments import experiment_session
from amb_bringup.experiments.experiment_session import GraphChoice, run_session
from amb_bringup.graph.launcher import Graph as LaunchedGraph
from amb_bringup.graph.launcher import launch_file
from amb_bringup.graph.packages import find_executable
from amb_core.excitation import Square
from amb_core.ground.errors import AmbError
from amb_core.recording import Recording
from tests.graph.conftest import Graph
from tests.graph.limits import TIMEOUT
from tests.graph.rig import PATIENT, UNHURRIED

AMB = str(find_executable("amb_bringup", "amb"))


def test_one_command_starts_a_graph_and_leaves_bag_and_report(graph: Graph, tmp_path: Path) -> None:
    words = ["multisine", "--amplitude", "5um", "--duration", "0.3s", "--frequency-end", "1.5kHz"]
    process = graph.start_command(
        [AMB, "experiment", *words, "--set", "rotor.mass=5kg", "--out", str(tmp_path / "out")]
    )
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 0, process.said
    recording = Recording.read(tmp_path / "out" / "bag")
    assert not recording.truncated
    record = recording.telemetry(recording.runs[-1])
    assert (record.first_step, record.steps) == (0, 2_000 + 3_000)
    parameters = recording.parameters_of("simulator")
    assert parameters is not None
    assert parameters["rotor.mass"] == 5.0
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_ctrl_c_lands_and_closes_the_recording(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    words = ["square", "--amplitude", "5um", "--duration", "500s", "--record", str(bag)]
    process = graph.start_command([AMB, "experiment", *words], stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert any(line.startswith("square: 0 / ") for line in process.stdout)
    process.send_signal(signal.SIGINT)
    shown, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130, errors
    assert f"landed; the recording is closed: {bag}" in " ".join(shown.split())
    assert not Recording.read(bag).truncated


def test_the_client_does_the_same_on_a_graph_that_runs(tmp_path: Path, own_domain: Callable[[], Any]) -> None:
    with own_domain() as domain:
        environment = {"ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(tmp_path)}
        with (
            LaunchedGraph.from_launch_file(launch_file("composed"), env=environment),
            AmbClient(domain_id=domain, timeout=TIMEOUT) as amb,
        ):
            (done,) = amb.experiment("square", tmp_path / "one", amplitude=5e-6, duration=0.1, axes="x", frequency=20.0)
            assert (done.first_step, done.steps) == (2_000, 1_000)
            assert Recording.read(tmp_path / "one").telemetry(done.run).steps == done.end

            small, large = (Square(amplitude=size, duration=0.1, axes="x", frequency=20.0) for size in (5e-6, 5e-4))
            with pytest.raises(AmbError, match="large: the rotor delevitated before step"):
                amb.experiment([Experiment("small", small), Experiment("large", large)], tmp_path / "two")
            fallen = Recording.read(tmp_path / "two")
            assert not fallen.truncated
            assert len(fallen.runs) == 2
            with pytest.raises(ClientError, match="there is no experiment to carry out"):
                amb.experiment([])


def test_no_graph_is_started_beside_another_that_is_found_late(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    monkeypatch.setattr(experiment_session, "graph_runs", lambda _amb: False)  # as on a loaded machine
    graph.start("amb_sim_node.simulator")
    graph.wait_until(lambda: "simulator" in graph.node.get_node_names(), "the other graph")
    experiments = [Experiment("square", Square(amplitude=5e-6, duration=0.1, axes="x", frequency=20.0))]
    with pytest.raises(ClientError, match=f"another graph runs in the DDS domain {graph.domain}: .* simulator too"):
        run_session(experiments, tmp_path / "bag", GraphChoice(), lambda *_: None)
    assert not (tmp_path / "bag").exists()


def test_a_client_finds_the_graph_of_its_own_namespace_beside_another(graph: Graph) -> None:
    graph.add_node("simulator", "/left")
    graph.add_node("hardware_bridge", "/right")
    with (
        AmbClient("left", domain_id=graph.domain, timeout=TIMEOUT) as left,
        AmbClient("right", domain_id=graph.domain, timeout=TIMEOUT) as right,
    ):
        for amb in (left, right):
            amb.wait_until(lambda amb=amb: {"simulator", "hardware_bridge"} <= set(amb.node.get_node_names()))
        stands = [type(running_stand(amb, lambda *_: None)) for amb in (left, right)]
        assert stands == [SimulatorStand, RigStand]
        with pytest.raises(ClientError, match="/right/simulator/run needs a simulator; this graph has a rig"):
            right.run(1)


@pytest.mark.slow
def test_a_rig_is_levitated_excited_and_landed(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    words = ["multisine", "--amplitude", "2um", "--duration", "1s", "--record", str(bag), "--no-report"]
    unhurried = {f"target_emulator.{name}": value for name, value in UNHURRIED.items() if name != "port"}
    patient = {f"hardware_bridge.link.{name}": value for name, value in PATIENT.items()}
    changes = [f"--set={name}={value}" for name, value in (unhurried | patient).items()]
    command = [AMB, "experiment", *words, "--rig", "--emulator", *changes]
    process = graph.start_command(command, stdout=subprocess.PIPE)
    shown, errors = process.communicate(timeout=2.0 * TIMEOUT)
    assert process.returncode == 0, errors
    assert all(f"{stage}: done" in shown for stage in ("connect", "levitate", "multisine", "land"))
    recording = Recording.read(bag)
    assert not recording.truncated
    assert recording.telemetry(recording.runs[-1]).steps > 10_000
