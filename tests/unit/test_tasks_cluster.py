"""The local cluster of tasks: other users of the machine reach its ports, and must not run code by them."""

from __future__ import annotations

import io
import logging
import os
import socket
import ssl
from collections.abc import Iterator

import psutil
import pytest
from distributed import Client, Security, SpecCluster

from amb_core.ground.tasks.cluster import open_cluster
from tests.semaphores import left_of, semaphores_of

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


def test_nothing_of_it_is_left_in_shared_memory() -> None:
    before = psutil.Process().children(recursive=True)
    with open_cluster(workers=2) as client:
        client.submit(os.getpid).result()
        own = set(psutil.Process().children(recursive=True)) - set(before)
        opened = semaphores_of(own)
        assert len(opened) >= 2, "of each worker"
    assert left_of(opened) == []


def test_what_dask_does_after_the_end_is_no_word_to_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its event loop ends later than the cluster, and may find closed connections by then (a Ctrl-C)."""
    log, shown, close = logging.getLogger("distributed"), io.StringIO(), SpecCluster._close

    async def close_and_go_on(cluster: SpecCluster) -> None:
        await close(cluster)
        for kind in ("batched", "client", "gc", "scheduler"):
            logging.getLogger(f"distributed.{kind}").critical("after the end")

    monkeypatch.setattr(SpecCluster, "_close", close_and_go_on)
    handler = logging.StreamHandler(shown)
    log.addHandler(handler)
    levels = [logging.getLogger(name).level for name in ("distributed", "distributed.client", "distributed.gc")]
    try:
        with open_cluster(workers=1) as client:
            assert client.submit(os.getpid).result() != os.getpid()
    finally:
        log.removeHandler(handler)
    assert shown.getvalue() == ""
    assert levels == [logging.getLogger(name).level for name in ("distributed", "distributed.client", "distributed.gc")]


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
