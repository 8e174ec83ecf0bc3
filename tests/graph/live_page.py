"""The live page as a process of a graph, a browser that opens it, and a client that means harm."""

from __future__ import annotations

import http.client
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import Log

from amb_bringup.graph.packages import find_executable
from amb_ros.qos import EVERY_STATE
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ADDRESS = re.compile(r"http://(\S+):(\d+)/#token=(\S+)")
MARKUP = "<img src=x onerror=\"globalThis.executed = 'log'\"><script>globalThis.executed = 'script'</script>"
UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


class LivePage:
    """A server of the live page in the domain of a graph."""

    def __init__(self, graph: Graph, *options: str) -> None:
        self.graph = graph
        self._output = graph.folder / f"view_{time.monotonic_ns()}.txt"
        command = [str(find_executable("amb_bringup", "amb")), "view", "--port", "0", *options]
        with self._output.open("w") as output:
            self.process = graph.start_command(command, stdout=output)
        graph.wait_until(lambda: ADDRESS.search(self.output) or self.process.poll() is not None, "the live page")
        address = ADDRESS.search(self.output)
        assert address, self.process.said
        self.host, self.port, self.token = address[1], int(address[2]), address[3]

    @property
    def output(self) -> str:
        """What the server wrote to its terminal."""
        return self._output.read_text()

    @property
    def address(self) -> str:
        """Address of the page without the token."""
        return f"http://{self.host}:{self.port}/"

    @property
    def address_with_token(self) -> str:
        """Address of the page that gives orders."""
        return f"{self.address}#token={self.token}"

    def status(self, path: str = "/", **headers: str) -> int:
        """Status of the answer to a request with these headers."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=TIMEOUT)
        try:
            connection.request("GET", path, headers=headers)
            return connection.getresponse().status
        finally:
            connection.close()

    def upgrade_status(self, **headers: str) -> int:
        """Status of the answer to a request for the websocket; 101 if it is opened."""
        return self.status("/live", **(UPGRADE | headers))


@contextmanager
def open_browser() -> Iterator[Any]:
    """Chromium, headless."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """The page in a browser, with what it complained of and asked for."""

    def __init__(self, browser: Any, address: str, **options: Any) -> None:
        self.page = browser.new_page(**options)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(address)

    def value(self, expression: str) -> Any:
        """Value of an expression in the page."""
        return self.page.evaluate(expression)

    def wait(self, expression: str, timeout: float = TIMEOUT) -> Any:
        """Wait until an expression is true in the page; asked again and again, since the page forbids `eval`."""
        deadline = time.monotonic() + timeout
        while not (value := self.page.evaluate(expression)):
            assert time.monotonic() < deadline, f"{expression} did not become true: {self.complaints}"
            self.page.wait_for_timeout(20)
        return value

    def text(self, selector: str) -> str:
        """Text of an element."""
        return str(self.page.locator(selector).text_content())

    def order(self, button: str, answer: str) -> None:
        """Press a button and wait for this in the answer."""
        self.page.get_by_role("button", name=button, exact=True).click()
        self.wait("!document.getElementById('answer').textContent.endsWith('…')")
        shown = self.text("#answer")
        assert answer in shown, shown

    def close(self) -> None:
        """Close the page."""
        self.page.close()


def publish_markup(graph: Graph) -> Any:
    """Put markup into the log of the graph, as text of a node; the publisher."""
    publisher = graph.node.create_publisher(Log, "/rosout", EVERY_STATE)
    publisher.publish(Log(level=40, name=MARKUP, msg=MARKUP))
    return publisher


HOSTILE_MESSAGES = (
    "{", "[]", "null", "7", '"unlock"', "{}", '{"do": null}', '{"do": "eval"}', '{"do": ["order"]}', "[" * 2000,
    '{"do": "unlock"}', '{"do": "unlock", "token": null}', '{"do": "unlock", "token": "wrong"}',
    '{"do": "unlock", "token": ["a"]}', '{"do": "window", "level": -1}', '{"do": "window", "level": 1e99}',
    '{"do": "window", "level": true}', '{"do": "order", "order": "run"}', '{"do": "order", "order": "pause"}',
    '{"do": "order", "order": "__class__", "settings": []}', '{"do": "ping", "at": {}}', "x" * 100_000, "\u0000" * 100,
)  # fmt: skip
"""What a client without the token may send."""


def attack(visit: Visit, address: str) -> int:
    """Send the hostile messages, each over a websocket of its own; how many were answered as an order would be.

    Raises
    ------
    AssertionError
        If not every one was answered with a refusal or the end of the connection.
    """
    script = """async ([address, messages]) => {
        let carriedOut = 0, refused = 0;
        for (const message of messages) {
            await new Promise((finish) => {
                const socket = new WebSocket(address.replace("http", "ws") + "live");
                let given = false;
                const give = setTimeout(() => { given = true; socket.close(); }, 5000);
                socket.onopen = () => socket.send(message);
                socket.onmessage = ({ data }) => {
                    const type = typeof data === "string" ? JSON.parse(data).type : "frame";
                    if (type === "answer" || type === "unlocked") carriedOut++;
                    if (type !== "problem" && type !== "pong") return;
                    refused++;
                    socket.onclose = finish;
                    socket.close();
                };
                socket.onclose = () => { refused += given ? 0 : 1; clearTimeout(give); finish(); };
            });
        }
        return [carriedOut, refused];
    }"""
    carried_out, refused = visit.page.evaluate(script, [address, list(HOSTILE_MESSAGES)])
    assert refused == len(HOSTILE_MESSAGES), f"{refused} of {len(HOSTILE_MESSAGES)} hostile messages were refused"
    return int(carried_out)
