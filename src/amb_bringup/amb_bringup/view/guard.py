"""Who may read the live page, and who may give orders.

A page of another site that is open in the same browser can reach a server on the loopback interface. Therefore the
server checks the headers Host (against names that another site points to this machine: DNS rebinding) and Origin, and
takes orders only with a secret token, which is in the part of the address that browsers do not send.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Of every answer: scripts and styles come from the server's files only, and nothing is loaded from elsewhere."""

LOCAL = ("localhost", "127.0.0.1", "::1")


class Guard:
    """Checks hosts, origins and tokens.

    Parameters
    ----------
    host : str
        Address to which the server is bound.
    read_only : bool
        Whether no token opens the orders.

    Attributes
    ----------
    token : str
        The token, 144 random bits; empty if the server is read-only.
    """

    def __init__(self, host: str, read_only: bool = False) -> None:
        self.token = "" if read_only else secrets.token_urlsafe(18)
        self._only_local = is_loopback(host)

    def knows_host(self, host: str) -> bool:
        """Whether a header Host names this machine, by a name that no other site controls; the port may differ."""
        name = _name_in(host)
        if name in LOCAL:
            return True
        return not self._only_local and (_is_address(name) or name == socket.gethostname().lower())

    def knows_origin(self, origin: str | None, host: str) -> bool:
        """Whether a header Origin is that of our own page, opened under this Host."""
        return origin is not None and origin.lower() == f"http://{host.lower()}" and self.knows_host(host)

    def opens(self, token: object) -> bool:
        """Whether this is the token; in constant time."""
        if not self.token or not isinstance(token, str):
            return False
        return hmac.compare_digest(token.encode(errors="replace"), self.token.encode())


def is_loopback(host: str) -> bool:
    """Whether only programs on this machine reach a server at this address."""
    return host == "localhost" or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def _name_in(host: str) -> str:
    """The name in a header Host, without port and brackets."""
    name = host.lower()
    if name.startswith("["):
        return name[1:].split("]", 1)[0]
    return name.split(":", 1)[0]


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
