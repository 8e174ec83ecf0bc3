"""`amb foxglove`: a running graph in Foxglove."""

from __future__ import annotations

import signal
import threading
from typing import Annotated

import typer

from amb_ros.interruptions import ending_signals

DEFAULT_PORT = 8765


def foxglove(
    host: Annotated[
        str, typer.Option(help="Address to bind to; with another one everybody in the network may look.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any free one.")] = DEFAULT_PORT,
) -> None:
    """Show a running graph live in Foxglove, every sample of it, until Ctrl-C; needs the extra foxglove.

    Viewers can look, and give no orders.
    """
    from amb_bringup.view.foxglove_bridge import FoxgloveBridge  # takes seconds to import
    from amb_bringup.view.guard import is_loopback
    from amb_ros import middleware

    middleware.configure()
    bridge = FoxgloveBridge(host, port, lambda problem: typer.echo(f"amb: left out: {problem}", err=True))
    if not is_loopback(host):
        typer.secho(f"amb: warning: {host} is open to the network, without encryption", fg="yellow", err=True)
    ended = threading.Event()
    for number in ending_signals():
        signal.signal(number, lambda *_: ended.set())
    typer.echo(f"amb: open in Foxglove: {bridge.address}")
    bridge.serve(ended)
    typer.echo("amb: stopped", err=True)
