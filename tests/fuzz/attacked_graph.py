"""The graph under attack: all nodes as processes in a DDS domain of their own, their memory and their logs."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import threading
from collections.abc import Iterator
from pathlib import Path

import yaml
from domain_coordinator import domain_id

from amb_bringup.client import NODES
from amb_bringup.client.connection import GraphConnection
from amb_bringup.graph.launcher import Graph, launch_file
from amb_bringup.graph.packages import share_folder
from amb_ros import middleware

NAMESPACE = "amb"
ANSWER_TIMEOUT = 60.0  # s; a node that answers nothing for so long counts as dead
ADDRESS_SPACE = 8 << 30  # bytes of a node: one that reads without end fails instead of the machine

_INTERNAL = re.compile(r"internal error|^Traceback \(most recent call last\)|Fatal Python error")


class ErrorLog:
    """Lines of the nodes' logs that tell of errors which nobody meant to report."""

    def __init__(self) -> None:
        self._lines: dict[str, list[str]] = {}
        self._lock = threading.Lock()

    def read(self, node: str, line: str) -> None:
        """Take in a line of a node's log."""
        if _INTERNAL.search(line):
            with self._lock:
                self._lines.setdefault(node, []).append(line)

    def take(self) -> dict[str, list[str]]:
        """The lines since the last look, by node."""
        with self._lock:
            taken, self._lines = self._lines, {}
        return taken


class AttackedGraph:
    """The running graph, a connection to it and the errors in its logs.

    Parameters
    ----------
    folder : Path
        Receives parameters, logs and bags.
    domain : int
        DDS domain.
    check_fields : bool
        Whether the nodes run with ROS_PYTHON_CHECK_FIELDS, as tests do and users do not.
    """

    def __init__(self, folder: Path, domain: int, check_fields: bool) -> None:
        self.bags = folder / "bags"
        self.errors = ErrorLog()
        environment = {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_LOG_DIR": str(folder / "log"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_PYTHON_CHECK_FIELDS": "1" if check_fields else "",
            "XDG_CACHE_HOME": str(folder / "cache"),
        }
        parameters = {"params": str(_parameter_file(folder, self.bags))}
        self.nodes = Graph.from_launch_file(launch_file("bearing"), parameters, environment, self.errors.read)
        self.nodes.start()
        self.connection = GraphConnection(NAMESPACE, ANSWER_TIMEOUT, domain, NODES)

    def close(self) -> None:
        """End the nodes and leave the graph."""
        self.connection.close()
        self.nodes.stop()

    def limit_memory(self, node: str) -> None:
        """Bound what a node may ask for."""
        resource.prlimit(self.nodes.processes[node].pid, resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))

    def memory(self) -> dict[str, int]:
        """Resident memory of each node (bytes)."""
        page = resource.getpagesize()
        return {
            name: page * int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
            for name, process in self.nodes.processes.items()
            if process.poll() is None
        }

    def restart(self, node: str) -> None:
        """Kill a node, if it still runs, and start it again."""
        process = self.nodes.processes[node]
        process.kill()
        process.wait()
        self.nodes.start_node(node)


@contextlib.contextmanager
def open_graph(folder: Path, check_fields: bool) -> Iterator[AttackedGraph]:
    """Start the graph in a domain of its own, with its files in a folder; it ends with the context."""
    middleware.configure()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with domain_id() as domain:
        graph = AttackedGraph(folder, domain, check_fields)
        try:
            yield graph
        finally:
            graph.close()


def _parameter_file(folder: Path, bags: Path) -> Path:
    """The paper's parameters, with bags in a folder of their own and little telemetry kept, for quick answers."""
    content = yaml.safe_load((share_folder("amb_bringup") / "config" / "paper.yaml").read_text())
    for node, values in (("recorder", {"directory": str(bags)}), ("identifier", {"max_steps": 2_000})):
        section = content.setdefault(f"/{NAMESPACE}/{node}", {"ros__parameters": {}})
        section["ros__parameters"].update(values)
    file = folder / "parameters.yaml"
    file.write_text(yaml.safe_dump(content))
    return file
