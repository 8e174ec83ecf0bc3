"""The server of the live page: files, and a websocket per page. One thread; listening and orders have their own."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import time
from concurrent.futures import Future as ThreadFuture
from importlib.resources import files
from typing import Any, ClassVar

from amb_bringup.view.guard import HEADERS, Guard
from amb_bringup.view.hub import FRAME_RATE, MOST_PAGES, Hub
from amb_bringup.view.listener import GraphListener
from amb_bringup.view.orders import Orders, forms, reason
from amb_bringup.view.picture import Picture
from amb_bringup.view.samples import FACTORS, Seen
from amb_core.ground.errors import AmbError
from amb_core.ground.extras import extra

with extra("view", of="amb_bringup"):
    from tornado.httpserver import HTTPServer
    from tornado.netutil import bind_sockets
    from tornado.web import Application, RequestHandler
    from tornado.websocket import WebSocketClosedError, WebSocketHandler

LARGEST_MESSAGE = 4096  # bytes from a page
LARGEST_HEADER = 16 * 1024  # bytes
MESSAGES_PER_SECOND = 50.0  # from a page
BURST = 100.0  # messages
MOST_MISTAKES = 5  # wrong tokens and malformed messages of a page, before it is closed
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013  # RFC 6455, 7.4.1
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class ViewError(AmbError):
    """The live page cannot be served."""


class ViewServer:
    """Serves the live page of the graph in the DDS domain of this process.

    Parameters
    ----------
    host : str
        Address to bind to.
    port : int
        Port; 0 for any free one.
    read_only : bool
        Whether nobody may give orders.
    picture : Picture
        What is shown.

    Raises
    ------
    ViewError
        If address and port cannot be bound.
    """

    def __init__(self, host: str, port: int, read_only: bool, picture: Picture) -> None:
        self.guard, self.picture, self.hub = Guard(host, read_only), picture, Hub(picture)
        try:
            self._sockets = bind_sockets(port, host)
        except OSError as problem:
            raise ViewError(_binding_problem(host, port, problem)) from None
        self._host, self.port = host, int(self._sockets[0].getsockname()[1])
        self.orders = Orders(lambda: picture.samples.run)

    @property
    def address(self) -> str:
        """Address of the page, without the token."""
        name = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{name}:{self.port}/"

    async def serve(self, ended: asyncio.Event) -> None:
        """Serve until `ended` is set."""
        listener = GraphListener()
        server = HTTPServer(
            Application([(r"/live", LivePage, {"server": self}), (r"/(.*)", PageFile, {"guard": self.guard})],
                        websocket_max_message_size=LARGEST_MESSAGE, websocket_ping_interval=20, log_function=_no_log),
            max_header_size=LARGEST_HEADER, max_body_size=LARGEST_MESSAGE, idle_connection_timeout=60, body_timeout=5,
        )  # fmt: skip
        server.add_sockets(self._sockets)
        ticking = asyncio.create_task(self._tick(listener))
        try:
            done, _ = await asyncio.wait(
                {ticking, asyncio.create_task(ended.wait())}, return_when=asyncio.FIRST_COMPLETED
            )
            for task in done:
                task.result()
        finally:
            ticking.cancel()
            server.stop()
            for page in list(self.hub.pages):
                page.close(1001, "the server ends")  # type: ignore[attr-defined]
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(server.close_all_connections(), 1.0)
            self.orders.close()
            await asyncio.to_thread(listener.close)

    async def _tick(self, listener: GraphListener) -> None:
        """Take the messages in and send frames, at an even rate; ticks that come too late are left out."""
        period, due = 1.0 / FRAME_RATE, time.monotonic()
        while True:
            for _ in range(len(listener.messages)):
                self.picture.take(*listener.messages.popleft())
            self.hub.tick()
            due = max(due + period, time.monotonic())
            await asyncio.sleep(due - time.monotonic())


class PageFile(RequestHandler):
    """The files of the page, from memory: no path of a request reaches the file system."""

    FILES: ClassVar[dict[str, bytes]] = {
        entry.name: entry.read_bytes() for entry in files("amb_bringup.view").joinpath("page").iterdir()
    }

    def initialize(self, guard: Guard) -> None:
        """Take the guard."""
        self._guard = guard

    def set_default_headers(self) -> None:
        """Send the headers of every answer."""
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse other names of this machine."""
        if not self._guard.knows_host(self.request.host):
            self.send_error(403, reason="Unknown host")

    def get(self, name: str) -> None:
        """Answer with a file."""
        name = name or "index.html"
        content, kind = self.FILES.get(name), TYPES.get(f".{name.rsplit('.', 1)[-1]}")
        if content is None or kind is None:
            self.send_error(404)
            return
        self.set_header("Content-Type", kind)
        self.finish(content)

    def write_error(self, status_code: int, **_: Any) -> None:
        """Answer with the status alone: nothing of the request is repeated."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}\n")


class LivePage(WebSocketHandler):
    """The websocket of one page."""

    def initialize(self, server: ViewServer) -> None:
        """Take the server."""
        self._server = server
        self.seen, self.known, self.line = Seen(), {}, 0  # type: ignore[var-annotated]
        self._greeted = self._unlocked = False
        self._mistakes, self._allowance, self._heard = 0, BURST, time.monotonic()
        self._sending: asyncio.Future[None] | None = None

    def prepare(self) -> None:
        """Refuse pages of other sites, and programs that do not name their origin."""
        guard, request = self._server.guard, self.request
        if not guard.knows_origin(request.headers.get("Origin"), request.host):
            self.send_error(403, reason="Unknown origin")

    def check_origin(self, origin: str) -> bool:
        """Whether the origin is ours; `prepare` has refused a missing one."""
        return self._server.guard.knows_origin(origin, self.request.host)

    def open(self, *_: str) -> None:
        """Greet the page."""
        if len(self._server.hub.pages) >= MOST_PAGES:
            self.close(TRY_AGAIN_LATER, f"{MOST_PAGES} pages are open")
            return
        self.set_nodelay(True)
        self._greeted = True
        self._server.hub.pages.add(self)
        hello = {"type": "hello", "readOnly": not self._server.guard.token, "forms": forms()}
        self.send(json.dumps(hello))

    def on_close(self) -> None:
        """Forget the page."""
        self._greeted = False
        self._server.hub.pages.discard(self)

    def ready(self) -> bool:
        """Whether everything sent so far has left."""
        return self._sending is None or self._sending.done()

    def send(self, message: str | bytes) -> None:
        """Send a message, without waiting."""
        if self._greeted:
            with contextlib.suppress(WebSocketClosedError):
                self._sending = asyncio.ensure_future(
                    _sent(self.write_message(message, binary=isinstance(message, bytes)))
                )

    def on_message(self, message: str | bytes) -> None:
        """Do what a page asks for."""
        now = time.monotonic()
        self._allowance = min(BURST, self._allowance + (now - self._heard) * MESSAGES_PER_SECOND) - 1.0
        self._heard = now
        if self._allowance < 0.0:
            self.close(POLICY_VIOLATION, "too many messages")
            return
        try:
            content = json.loads(message)
        except (ValueError, RecursionError):
            content = None
        asked = content.get("do") if isinstance(content, dict) else None
        if asked == "ping":
            at = content["at"] if isinstance(content.get("at"), int | float) else 0
            self.send(json.dumps({"type": "pong", "at": at}))
        elif asked == "window" and type(content.get("level")) is int and 0 <= content["level"] < len(FACTORS):
            self.seen.level, self.seen.column = content["level"], 0
        elif asked == "unlock":
            self._unlock(content.get("token"))
        elif asked == "order":
            self._order(content)
        else:
            self._mistake("a message is not understood")

    def _mistake(self, text: str) -> None:
        self._mistakes += 1
        if self._mistakes >= MOST_MISTAKES:
            self.close(POLICY_VIOLATION, text)
        else:
            self.send(json.dumps({"type": "problem", "text": text}))

    def _unlock(self, token: object) -> None:
        if self._server.guard.opens(token):
            self._unlocked = True
            self.send(json.dumps({"type": "unlocked"}))
        else:
            self._mistake("this token does not open the orders; the terminal of `amb view` shows the right address")

    def _order(self, content: dict[str, Any]) -> None:
        if not self._unlocked:
            self._mistake("this page is read-only: open the address that the terminal of `amb view` shows")
            return
        number = content.get("number")
        number = number if type(number) is int and abs(number) < 2**53 else 0
        orders, order = self._server.orders, content.get("order")
        loop = asyncio.get_running_loop()

        def answer(ok: bool, text: str, final: bool = True) -> None:
            self.send(json.dumps({"type": "answer", "number": number, "ok": ok, "text": text, "final": final}))

        def report(text: str) -> None:
            loop.call_soon_threadsafe(answer, True, text, False)

        def finish(done: ThreadFuture[str]) -> None:
            problem = done.exception()
            ok = problem is None
            text = done.result() if ok else reason(problem)  # type: ignore[arg-type]
            with contextlib.suppress(RuntimeError):  # the server has ended meanwhile
                loop.call_soon_threadsafe(answer, ok, text)

        try:
            lane = orders.lane(order)
        except AmbError as problem:
            answer(False, reason(problem))
            return
        lane.submit(orders.carry_out, str(order), content.get("settings", {}), report).add_done_callback(finish)


async def _sent(sending: Any) -> None:
    """Wait until a message has left; nothing is to be done for a page that has gone meanwhile."""
    with contextlib.suppress(WebSocketClosedError):
        await sending


def _binding_problem(host: str, port: int, problem: OSError) -> str:
    if problem.errno == errno.EADDRINUSE:
        return f"port {port} of {host} is in use; end the program that uses it, or choose another with --port (0: any)"
    return f"{host}, port {port}: {problem.strerror or problem}; choose another address (--host) or port (--port)"


def _no_log(_handler: RequestHandler) -> None:
    """Write no line for every request."""
