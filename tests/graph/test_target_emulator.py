"""The node `target_emulator` as a host and a user of ROS see it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from amb_bringup.graph.packages import find_executable
from amb_core.rig.link import CommandWriter, Description, Reply, commands, decode, hello, machine_of
from tests.graph.conftest import Graph
from tests.graph.limits import TIMEOUT
from tests.graph.processes import NodeProcess

RIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config" / "rig.yaml"
MODULE = "amb_sim_node.target_emulator"
UNHURRIED = {"port": 0, "real_time_factor": 0.02, "limits.missed_steps": 1e9, "plant_waits": True, "ideal": True}


class Emulated:
    """A running emulator: its diagnostics, and a host."""

    def __init__(self, graph: Graph, *arguments: str, **parameters: Any) -> None:
        self.graph = graph
        self.statuses: list[DiagnosticStatus] = []
        graph.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.process: NodeProcess = graph.start(MODULE, *arguments, parameters=UNHURRIED | parameters)
        graph.wait_until(self.values, "diagnostics of the emulator")
        self.host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.host.settimeout(TIMEOUT)
        self.host.connect(("127.0.0.1", int(self.values()["UDP port"])))

    def values(self) -> dict[str, str]:
        return {item.key: item.value for item in self.statuses[-1].values} if self.statuses else {}

    def wait_for(self, condition: Callable[[DiagnosticStatus, dict[str, str]], object], what: str) -> None:
        self.graph.wait_until(lambda: condition(self.statuses[-1], self.values()), what)

    def connect(self, key: bytes = b"") -> Description:
        self.host.send(hello())
        while not isinstance(description := decode(self.host.recv(2048)), Description):
            pass
        self.session = description.session(key)
        self.writer = CommandWriter(self.session, description.counter)
        return description

    def command(self, command: Any) -> Reply:
        self.host.send(self.writer.write(command))
        while not isinstance(answer := decode(self.host.recv(2048), self.session), Reply):
            pass
        return answer

    def set(self, name: str, value: object) -> Any:
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        (result,) = self.graph.call(SetParameters, "/amb/target_emulator/set_parameters", parameters=parameters).results
        return result

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        self.statuses += [status for status in array.status if status.name == "amb/target_emulator"]


def test_a_host_finds_the_machine_of_the_parameter_file_with_which_the_node_was_started(graph: Graph) -> None:
    emulated = Emulated(graph, "--params-file", str(RIG))
    machine = machine_of([emulated.connect()])
    assert (machine.name, machine.axis_names) == ("rigid", ("x_a", "y_a", "x_b", "y_b"))
    assert emulated.command(commands.heartbeat()).code == 0
    emulated.wait_for(lambda _, values: values["state"] == "OFF", "the state")


def test_with_a_key_it_may_listen_to_other_machines_and_takes_sealed_commands(graph: Graph, tmp_path: Path) -> None:
    key = bytes(range(16))
    file = tmp_path / "key"
    file.write_text(key.hex())
    file.chmod(0o600)
    emulated = Emulated(graph, address="0.0.0.0", key_file=str(file))
    assert emulated.connect(key).with_key
    assert emulated.command(commands.heartbeat()).status.forged == 0


def test_faults_are_parameters_trips_are_diagnostics_and_a_service_boots(graph: Graph) -> None:
    emulated = Emulated(graph, parameter_file="package://amb_bringup/config/rig.yaml")
    assert emulated.connect().axes == 4
    assert emulated.command(commands.stream(5)).code == 0
    assert emulated.command(commands.levitate(0.0)).code == 0
    emulated.wait_for(lambda _, values: values["amplifiers"] == "on", "levitation")

    refused = emulated.set("faults.sensor.failed", "y_c")
    assert not refused.successful
    assert "names axis 'y_c'; axes: x_a, y_a, x_b, y_b" in refused.reason
    assert emulated.set("faults.sensor.failed", "y_b").successful
    emulated.wait_for(
        lambda status, _: status.level == DiagnosticStatus.WARN and "SENSOR_RANGE (axis 3" in status.message, "the trip"
    )
    assert emulated.values()["amplifiers"] == "off"

    booted = graph.call(Trigger, "/amb/target_emulator/reboot")
    assert booted.success
    assert "boot 2" in booted.message
    before = emulated.session.number
    emulated.connect()
    assert emulated.session.number != before
    emulated.wait_for(lambda _, values: values["boots"] == "2" and values["trips"] == "none", "the new boot")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_emulator_ends_with_its_node(graph: Graph, number: signal.Signals) -> None:
    emulated = Emulated(graph)
    port = int(emulated.values()["UDP port"])
    code, said = graph.stop(emulated.process, number)
    assert code == 0, said
    assert bindable(port)


def test_the_emulator_ends_when_its_node_is_killed(graph: Graph) -> None:
    emulated = Emulated(graph)
    port = int(emulated.values()["UDP port"])
    graph.stop(emulated.process, signal.SIGKILL)
    graph.wait_until(lambda: bindable(port), "the end of the emulator")


def bindable(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        try:
            other.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def test_an_emulator_that_dies_is_an_error_on_diagnostics_and_the_node_goes_on(graph: Graph) -> None:
    emulated = Emulated(graph)
    pid = emulated.process.pid
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    os.kill(int(child), signal.SIGKILL)
    graph.wait_until(lambda: ") Z " in Path(f"/proc/{child}/stat").read_text(), "the end of the emulator")
    refused = emulated.set("faults.sensor.failed", "x")  # at once, perhaps before the node knows
    assert "the process of the emulator has ended" in refused.reason
    emulated.wait_for(lambda status, _: status.level == DiagnosticStatus.ERROR, "the error")
    assert "the process of the emulator has ended" in emulated.statuses[-1].message
    answer = graph.call(Trigger, "/amb/target_emulator/reboot")
    assert not answer.success
    assert "has ended" in answer.message


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"address": "0.0.0.0"}, "address '0.0.0.0' without a key is not allowed"),
        ({"key_file": "/missing"}, "key file /missing: cannot be read: No such file or directory"),
        ({"parameter_file": "missing.yaml"}, "parameter file missing.yaml: cannot be read"),
        ({"faults.sensor.stuck": "z"}, "names axis 'z'; axes: x, y"),
        ({"rotor.gravity": 0.0}, "unknown parameter 'rotor.gravity'"),
    ],
)
def test_wrong_parameters_end_the_node_with_one_line(graph: Graph, parameters: dict[str, Any], reason: str) -> None:
    process = graph.start(MODULE, parameters=UNHURRIED | parameters)
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 1
    (line,) = process.said.splitlines()
    assert reason in line


def test_amb_jitter_shows_the_paced_nodes(graph: Graph) -> None:
    emulated = Emulated(graph)
    graph.start("amb_sim_node.simulator", parameters={"real_time_factor": 0.01, "autostart": True})
    graph.start("amb_controller_node.pd_controller")
    names = {"amb/simulator", "amb/target_emulator"}
    seen: set[str] = set()

    def both() -> bool:
        command = [str(find_executable("amb_bringup", "amb")), "jitter", "--seconds", "1.5", "--json"]
        process = graph.start_command(command, stdout=subprocess.PIPE)
        output, said = process.communicate(timeout=TIMEOUT)
        assert process.returncode == 0, said
        result = json.loads(output)
        seen.update(result)
        for node in result.values():
            lateness = list(node["lateness_us"].values())
            assert lateness == sorted(lateness)
            assert 0 <= node["missed"] <= node["missed_in_all"]
        return seen == names

    graph.wait_until(both, "both nodes")
    assert emulated.values()["blocks paced"] != "0"
