"""Settings of the middleware in every process: lost answers, who can reach the nodes, and a fault of it corrected.

A request may reach a service before discovery has matched the service with the client's reader for answers.
rmw_fastrtps then waits 100 ms for the match and drops the answer, with only a warning (ros2/rmw_fastrtps, issue 842). A
loaded machine takes longer. A lost announcement is repeated within about 1.5 s, so 3 s allow for two of them. Parameter
services and actions of a node wait equally long, since the middleware does the waiting.

DDS has no access control here: whoever reaches a node commands it. With ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST the
nodes of Jazzy announce themselves on this host only, but their sockets still take packets from every network, so a peer
that knows the port gets in. For that range the profile binds the sockets to the loopback interface, too.

The fault and its correction are described in `overflowed_wait`. Middlewares other than rmw_fastrtps ignore the
settings.
"""

from __future__ import annotations

import os
from ipaddress import ip_address
from pathlib import Path
from socket import SOCK_DGRAM

from amb_ros import overflowed_wait

PROFILES = Path(__file__).with_name("fast_dds.xml")
LOCAL_PROFILES = Path(__file__).with_name("fast_dds_local.xml")
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PORT_BASE, DOMAIN_GAIN = 7400, 250  # PB and DG of DDSI-RTPS
THIS_HOST = ("LOCALHOST", "OFF")


def keep_to_this_host() -> None:
    """Limit the nodes of this process, and of those that it starts, to this host, unless the user has set a range."""
    if "ROS_LOCALHOST_ONLY" not in os.environ:  # it would hold instead, with a warning
        os.environ.setdefault(RANGE, "LOCALHOST")


def open_to_network() -> None:
    """Let hosts of the network find the nodes of this process, and of those that it starts."""
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    os.environ[RANGE] = "SUBNET"


def is_local() -> bool:
    """Whether the environment limits nodes to this host."""
    if "ROS_LOCALHOST_ONLY" in os.environ:
        return os.environ["ROS_LOCALHOST_ONLY"] == "1"
    return os.environ.get(RANGE, "").upper() in THIS_HOST and not os.environ.get("ROS_STATIC_PEERS")


def configure() -> None:
    """Apply the settings to this process unless the user has set their own; call it before `rclpy.init`.

    Then correct the fault by which a process can hang when it ends.
    """
    os.environ.setdefault(VARIABLE, str(LOCAL_PROFILES if is_local() else PROFILES))
    overflowed_wait.correct()


def sockets_open_to_network(domain: int, pid: int | None = None) -> list[str]:
    """Addresses at which other hosts reach the DDS participants of a process; empty if its nodes keep to this host.

    Parameters
    ----------
    domain : int
        Their DDS domain, which decides the UDP ports (DDSI-RTPS 2.5, section 9.6.2: 250 ports from 7400 + 250 domain).
        Ports elsewhere only send. A TCP port that listens counts, too.
    pid : int, optional
        The process; by default this one.
    """
    import psutil  # only a bridge needs it

    first = PORT_BASE + DOMAIN_GAIN * domain
    found = []
    for socket in psutil.Process(pid).net_connections("inet"):
        host, port = socket.laddr
        listens = socket.status == psutil.CONN_LISTEN
        receives = socket.type == SOCK_DGRAM and first <= port < first + DOMAIN_GAIN
        address = ip_address(host)
        if (listens or receives) and not (address.is_loopback or address.is_multicast):
            found.append(f"{host}:{port}")
    return sorted(found)
