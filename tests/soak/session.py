"""A rig as processes for the soak: emulated target, bridge and host nodes, each of which can be killed and started."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import psutil
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id

from amb_bringup.client import AmbClient
from amb_bringup.graph.launch_file import NodeProcess
from amb_bringup.graph.launcher import Graph
from amb_bringup.graph.packages import find_executable
from amb_core.ground.files.parameter_files import RIG_NODES

PACKAGES = {
    "target_emulator": "amb_sim_node",
    "hardware_bridge": "amb_sim_node",
    "excitation_generator": "amb_controller_node",
    "region_monitor": "amb_ident_node",
    "recorder": "amb_ident_node",
}
HOST = tuple(name for name in PACKAGES if name != "target_emulator")
FIRST_PORT = 61_500  # above those that a system gives away, and those of DDS domains in use


def emulator_port() -> int:
    """Port of the emulators of this process."""
    return FIRST_PORT + os.getpid() % 500


class Session:
    """Starts the nodes, and ends them with the context.

    Parameters
    ----------
    folder : Path
        For parameter files.
    machine : Path
        Parameter file of the machine.
    target_port : int, optional
        Port that the bridge uses, by default that of the emulator; another one for a tap in between.
    **parameters : dict
        Parameters by node.
    """

    def __init__(
        self, folder: Path, machine: Path, target_port: int | None = None, **parameters: dict[str, Any]
    ) -> None:
        self._reserved = contextlib.ExitStack()
        self.domain = self._reserved.enter_context(domain_id())
        self.port = emulator_port()
        own = {"target_emulator": {"port": self.port}, "hardware_bridge": {"link": {"port": target_port or self.port}}}
        for node, values in parameters.items():
            _merge(own.setdefault(node, {}), values)
        file = folder / "soak.yaml"
        file.write_text(yaml.safe_dump({f"/amb/{node}": {"ros__parameters": values} for node, values in own.items()}))
        files = ["--params-file", str(machine), "--params-file", str(file)]
        self.graph = Graph(
            [
                NodeProcess(node, (str(find_executable(package, node)), "--ros-args", "-r", "__ns:=/amb", *files))
                for node, package in PACKAGES.items()
            ],
            {"ROS_DOMAIN_ID": str(self.domain)},
        )
        self.diagnostics: dict[str, dict[str, str]] = {}

    def __enter__(self) -> Self:
        self.graph.start()
        self.amb = self._client()
        return self

    def _client(self) -> AmbClient:
        client = AmbClient(domain_id=self.domain, nodes=tuple(name for name in RIG_NODES if name in PACKAGES))
        client.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        return client

    def come_anew(self) -> None:
        """Leave the graph and join it again: who was there takes a killed node for alive for some twenty seconds."""
        self.amb.close()
        self.diagnostics.clear()
        self.amb = self._client()
        self.amb.wait_for_nodes()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.amb.close()
        self.graph.stop()
        self._reserved.close()

    def process(self, node: str) -> psutil.Process:
        """The process of a node."""
        return psutil.Process(self.graph.processes[node].pid)

    def kill(self, *nodes: str) -> None:
        """Kill nodes without warning."""
        for node in nodes:
            self.graph.processes[node].send_signal(signal.SIGKILL)
        for node in nodes:
            self.graph.processes[node].wait()

    def start(self, *nodes: str) -> None:
        """Start nodes again."""
        for node in nodes:
            self.graph.start_node(node)

    def wait_until(self, condition: Any, what: str, timeout: float = 60.0) -> None:
        """Process messages until a condition holds."""
        self.amb.wait_until(condition, timeout, f"{what} did not come")

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            name = status.name.rsplit("/", 1)[-1]
            self.diagnostics[name] = {item.key: item.value for item in status.values}


def _merge(into: dict[str, Any], values: dict[str, Any]) -> None:
    for name, value in values.items():
        if isinstance(value, dict) and isinstance(into.get(name), dict):
            _merge(into[name], value)
        else:
            into[name] = value
