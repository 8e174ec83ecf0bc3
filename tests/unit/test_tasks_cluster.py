"""The local cluster of tasks: other users of the machine reach its ports, and must not run code by them."""

from __future__ import annotations

import os
import socket
import ssl
from collections.abc import Iterator

import psutil
import pytest
from distributed import Client, Security

from amb_core.ground.tasks.cluster import open_cluster

OTHERS: set[int] = set()  # ports of the test run itself


@pytest.fixture(scope="module")
def cluster() -> Iterator[Client]:
    OTHERS.update(ports())
    with open_cluster(workers=1) as client:
        assert client.submit(os.getpid).result() != os.getpid()
        yield client


def ports() -> set[int]:
    """All TCP ports on which this process or one that it started listens."""
    me = psutil.Process()
    return {
        each.laddr.port
        for process in (me, *me.children(recursive=True))
        for each in process.net_connections("tcp")
        if each.status == psutil.CONN_LISTEN
    }


def test_a_client_without_the_key_of_the_run_is_refused(cluster: Client) -> None:
    port = cluster.scheduler.address.rsplit(":", 1)[1]
    for protocol, security in (("tcp", Security()), ("tls", Security.temporary())):
        with pytest.raises(OSError):
            Client(f"{protocol}://127.0.0.1:{port}", security=security, timeout=1.0, set_as_default=False)


def test_no_port_of_the_run_takes_a_message_of_dask_from_a_stranger(cluster: Client) -> None:
    opened = ports() - OTHERS
    assert len(opened) >= 3, "scheduler, worker and its nanny"
    for port in opened:
        assert not _answers(port, encrypted=False)
        assert not _answers(port, encrypted=True)


def test_the_key_is_in_no_argument_which_every_user_can_read(cluster: Client) -> None:
    workers = psutil.Process().children(recursive=True)
    assert workers
    assert not any("PRIVATE KEY" in argument for worker in workers for argument in worker.cmdline())


def _answers(port: int, encrypted: bool) -> bool:
    """Whether a port sends anything that is not an HTTP error to a peer without a certificate."""
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as plain:
        peer: socket.socket = plain
        try:
            if encrypted:
                context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
                context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
                peer = context.wrap_socket(plain)
            peer.sendall(b"GET /json/identity.json HTTP/1.0\r\n\r\n")
            answer = peer.recv(1_000)
        except OSError:  # refused
            return False
        return bool(answer) and not answer.startswith(b"HTTP/1.1 404")
