"""`amb view`: the live page of a running graph."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from amb_ros.interruptions import ending_signals

if TYPE_CHECKING:
    from amb_bringup.view.server import ViewServer

DEFAULT_PORT = 8642


def view(
    host: Annotated[str, typer.Option(help="Address to bind to; with another one the page is open to the network.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any free one.")] = DEFAULT_PORT,
    read_only: Annotated[bool, typer.Option("--read-only", help="Nobody may start or stop anything.")] = False,
    region_map: Annotated[
        Path | None, typer.Option("--map", help="Region map to show (JSON), until the region monitor publishes one.")
    ] = None,
) -> None:
    """Show a running graph live in the browser: motion, spectrum, regions, trips and log, until Ctrl-C.

    The address with the token, which the terminal shows, also allows to excite, record and identify.
    """
    from amb_bringup.view.picture import Picture  # takes seconds to import
    from amb_bringup.view.server import ViewServer
    from amb_core.regions.region_map import RegionMap
    from amb_ros import middleware

    picture = Picture()
    if region_map is not None:
        picture.use_map(RegionMap.load(region_map))
    middleware.configure()
    server = ViewServer(host, port, read_only, picture)
    _show_address(server, host)
    asyncio.run(_serve(server))
    typer.echo("amb: stopped", err=True)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # an order may still be waiting for its answer, and nobody for the order


def _show_address(server: ViewServer, host: str) -> None:
    from amb_bringup.view.guard import is_loopback

    token = server.guard.token
    if not is_loopback(host):
        typer.secho(
            f"amb: warning: {host} is open to the network, and neither samples nor token are encrypted", fg="yellow",
            err=True,
        )  # fmt: skip
    if token:
        typer.echo(f"amb: live page with orders: {server.address}#token={token}")
    typer.echo(f"amb: live page, read-only:   {server.address}")


async def _serve(server: ViewServer) -> None:
    ended = asyncio.Event()
    for number in ending_signals():
        asyncio.get_running_loop().add_signal_handler(number, ended.set)
    await server.serve(ended)
