"""The parameters of other nodes, read from a worker thread while the node itself keeps spinning."""

from __future__ import annotations

import time
from typing import Any, TypeVar

from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node, NodeNameNonExistentError

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Parameters, part_of
from amb_core.recording.messages.parameters import ParameterValue, parameters_from_messages
from amb_ros.requests import POLL_PERIOD, ask

P = TypeVar("P", bound=Parameters)


class RemoteParameters:
    """Reads parameters of the nodes in the graph; call it from another thread than the one that spins the node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[str, tuple[Client, Client]] = {}

    def nodes(self) -> list[str]:
        """Full names of the nodes in this node's namespace that report their parameters, itself included."""
        namespace = self._node.get_namespace()
        names = {name for name, space in self._node.get_node_names_and_namespaces() if space == namespace}
        prefix = namespace.rstrip("/")
        return sorted(f"{prefix}/{name}" for name in names if self._reports_parameters(name, namespace))

    def read(self, remote: str, timeout: float) -> dict[str, ParameterValue]:
        """All parameters of a node by name.

        Parameters
        ----------
        remote : str
            Full name of the node.
        timeout : float
            Longest wait for each answer (s).

        Raises
        ------
        ParameterError
            If the node does not answer in time.
        """
        if remote not in self._clients:
            self._wait_for(remote, timeout)
            self._clients[remote] = (
                self._node.create_client(ListParameters, f"{remote}/list_parameters"),
                self._node.create_client(GetParameters, f"{remote}/get_parameters"),
            )
        lister, getter = self._clients[remote]
        names = self._call(lister, ListParameters.Request(), remote, timeout).result.names
        values = self._call(getter, GetParameters.Request(names=names), remote, timeout).values
        return parameters_from_messages(
            Parameter(name=name, value=value) for name, value in zip(names, values, strict=True)
        )

    def read_set(self, model: type[P], remote: str, timeout: float) -> P:
        """A parameter set among the parameters of a node, such as those of the plant among the simulator's.

        Parameters
        ----------
        model : type[Parameters]
            The set.
        remote : str
            Name of the node, full or relative to the namespace of this one.
        timeout : float
            Longest wait for each answer (s).

        Raises
        ------
        ParameterError
            If the node does not answer in time, or a value is out of its range.
        """
        return part_of(model, self.read_all(remote, timeout))

    def read_all(self, remote: str, timeout: float) -> dict[str, ParameterValue]:
        """As `read`, of a node by its full name or the one relative to the namespace of this one."""
        if not remote.startswith("/"):
            remote = f"{self._node.get_namespace().rstrip('/')}/{remote}"
        return self.read(remote, timeout)

    def _wait_for(self, remote: str, timeout: float) -> None:
        """Wait until a node is in the graph: a client for a node that does not exist would never be removed."""
        deadline = time.monotonic() + timeout
        while remote not in {
            f"{space.rstrip('/')}/{name}" for name, space in self._node.get_node_names_and_namespaces()
        }:
            if time.monotonic() > deadline:
                raise _no_answer(remote, timeout)
            time.sleep(POLL_PERIOD)

    def _reports_parameters(self, name: str, namespace: str) -> bool:
        try:
            services = self._node.get_service_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:  # it has just ended
            return False
        return any(service.endswith(f"/{name}/list_parameters") for service, _ in services)

    def _call(self, client: Client, request: Any, remote: str, timeout: float) -> Any:
        answer = ask(client, request, timeout)
        if answer is None:
            raise _no_answer(remote, timeout)
        return answer


def _no_answer(remote: str, timeout: float) -> ParameterError:
    return ParameterError(f"node {remote} did not report its parameters within {timeout:g} s; is it running?")
