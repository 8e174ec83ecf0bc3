"""A graph of its own for one session: its processes and a client in it, and no other graph in its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.loop_calls import TIMEOUT
from amb_bringup.graph.launcher import Graph, launch_file
from amb_core.ground.files.parameter_files import NODES

PATIENCE = 120.0  # s; longest wait for the nodes, which start all at once, on a machine that has other work too


@contextmanager
def own_graph(
    name: str,
    arguments: Mapping[str, str],
    domain: int,
    nodes: Sequence[str] = NODES,
    timeout: float = TIMEOUT,
) -> Iterator[tuple[Graph, AmbClient]]:
    """Start a graph, wait for its nodes, and end it with the session.

    Parameters
    ----------
    name : str
        Name of its launch file.
    arguments : mapping
        Arguments of the launch file.
    domain : int
        Its DDS domain.
    nodes : sequence of str, optional
        Its nodes; by default those of a simulator.
    timeout : float, optional
        That of the client (s).

    Yields
    ------
    tuple of Graph and AmbClient
        The processes, and a client in the graph.

    Raises
    ------
    LaunchError, ClientError
        If a node does not start; if another graph runs in the domain, found now or only late on a loaded machine:
        requests would go to the nodes of both.
    """
    with (
        Graph.from_launch_file(launch_file(name), dict(arguments), {"ROS_DOMAIN_ID": str(domain)}) as graph,
        AmbClient(domain_id=domain, timeout=timeout, nodes=nodes) as amb,
    ):
        amb.wait_for_nodes(graph.check, PATIENCE)
        doubled = amb.doubled_nodes()
        if doubled:
            raise ClientError(
                f"another graph runs in the DDS domain {domain}: it has {', '.join(doubled)} too; end it, or "
                "set ROS_DOMAIN_ID to another domain"
            )
        yield graph, amb
