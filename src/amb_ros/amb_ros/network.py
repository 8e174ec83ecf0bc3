"""Who can reach the nodes of a process: this host only, or the network.

DDS has no access control here: whoever reaches a node commands it. With ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST the
nodes of Jazzy announce themselves on this host only, but their sockets still take packets from every network, so a peer
that knows the port gets in. For that range the profile of `middleware` binds the sockets to the loopback interface.
"""

from __future__ import annotations

import os
from ipaddress import ip_address
from socket import SOCK_DGRAM

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
THIS_HOST = ("LOCALHOST", "OFF")
PORT_BASE, DOMAIN_GAIN, UNICAST = 7400, 250, 10  # PB, DG and d1 of DDSI-RTPS


def keep_to_this_host() -> None:
    """Limit the nodes of this process, and of those that it starts, to this host, unless the user has set a range."""
    if not os.environ.get("ROS_LOCALHOST_ONLY"):  # it would hold instead, with a warning
        os.environ.setdefault(RANGE, "LOCALHOST")


def open_to_network() -> None:
    """Let hosts of the network find the nodes of this process, and of those that it starts."""
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    os.environ[RANGE] = "SUBNET"


def is_local() -> bool:
    """Whether the environment limits nodes to this host."""
    if os.environ.get("ROS_LOCALHOST_ONLY") == "1":  # with 0 the range holds
        return True
    return os.environ.get(RANGE, "").upper() in THIS_HOST and not os.environ.get("ROS_STATIC_PEERS")


def sockets_open_to_network(domain: int, pid: int | None = None) -> list[str]:
    """Addresses at which other hosts reach the DDS participants of a process; empty if its nodes keep to this host.

    Parameters
    ----------
    domain : int
        Their DDS domain, which decides the UDP ports (DDSI-RTPS 2.5, section 9.6.2: from 7400 + 250 domain). A TCP port
        that listens counts, too.
    pid : int, optional
        The process; by default this one.
    """
    import psutil  # only a bridge needs it

    sockets = psutil.Process(pid).net_connections("inet")
    receiving = _ports_of_participants(domain, {one.laddr.port for one in sockets if one.type == SOCK_DGRAM})
    addresses = []
    for socket in sockets:
        host, port = socket.laddr
        listens = socket.status == psutil.CONN_LISTEN
        receives = socket.type == SOCK_DGRAM and port in receiving
        address = ip_address(host)
        if (listens or receives) and not (address.is_loopback or address.is_multicast):
            addresses.append(f"{host}:{port}")
    return sorted(addresses)


def _ports_of_participants(domain: int, ports: set[int]) -> set[int]:
    """Those of a process's UDP ports at which its DDS participants receive.

    A participant has two neighbours, 10 + 2 i and 11 + 2 i of the domain's ports, and the multicast ports 0 and 1.
    Other sockets, which only send or are not of DDS, have any port that the system has free: from domain 102 on it may
    be one of the domain's.
    """
    first = PORT_BASE + DOMAIN_GAIN * domain
    pairs = {(port, port + 1) for port in range(first + UNICAST, first + DOMAIN_GAIN, 2)}
    unicast = {port for pair in pairs if ports.issuperset(pair) for port in pair}
    return unicast | (ports & {first, first + 1} if unicast else set())
