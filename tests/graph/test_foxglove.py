"""A running graph in Foxglove: a viewer gets every sample that arrived with its bits, and may give no orders.

Needs the extra foxglove (make setup EXTRAS=foxglove); without it these tests are left out.
"""

from __future__ import annotations

import asyncio
import json
import re
import signal
import struct
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from amb_bringup.graph.packages import find_executable
from amb_msgs.srv import Pause
from tests.graph.bearing import Bearing
from tests.graph.conftest import Graph

pytest.importorskip("foxglove", reason="the extra foxglove is not installed (make setup EXTRAS=foxglove)")

COMPOSED = "amb_bringup.graph.composed_loop"
TELEMETRY, STATE = "/amb/telemetry", "/amb/simulator/state"
MESSAGE = struct.Struct("<BIQ")  # kind 1, subscription, time (ns): Foxglove WebSocket protocol, "Message Data"


class Viewer:
    """What a viewer does: it looks at the list of channels, subscribes to all, and decodes by their schemas."""

    def __init__(self, address: str) -> None:
        self.channels: dict[str, dict[str, Any]] = {}
        self.texts: list[dict[str, Any]] = []
        self.messages: list[tuple[str, int, Any]] = []
        self._address, self._ending = address, threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._look()))
        self._thread.start()

    def of(self, topic: str) -> list[tuple[int, Any]]:
        return [(time, message) for name, time, message in list(self.messages) if name == topic]

    def close(self) -> None:
        self._ending.set()
        self._thread.join()

    async def _look(self) -> None:
        request = HTTPRequest(self._address)
        socket = await websocket_connect(request, subprotocols=["foxglove.sdk.v1"])
        by_number: dict[int, tuple[str, Any]] = {}
        while not self._ending.is_set():
            try:
                data = await asyncio.wait_for(
                    asyncio.shield(waiting := asyncio.ensure_future(socket.read_message())), 0.1
                )
            except TimeoutError:
                waiting.cancel()
                continue
            if data is None:
                break
            if isinstance(data, str):
                self.texts.append(json.loads(data))
                for channel in self.texts[-1].get("channels", ()):
                    self.channels[channel["topic"]] = channel
                    by_number[channel["id"]] = channel["topic"], _decoder(channel)
                    wanted = [{"id": channel["id"], "channelId": channel["id"]}]
                    await socket.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            elif data[0] == 1:
                _, number, stamp = MESSAGE.unpack_from(data)
                topic, decode = by_number[number]
                self.messages.append((topic, stamp, decode(data[MESSAGE.size :])))
        socket.close()


@pytest.fixture
def bridge(graph: Graph) -> Iterator[tuple[Any, str]]:
    """The process of the bridge, and its address."""
    output = graph.folder / "foxglove.txt"
    command = [str(find_executable("amb_bringup", "amb")), "foxglove", "--port", "0"]
    with output.open("w") as stream:
        process = graph.start_command(command, stdout=stream)
    graph.wait_until(lambda: "ws://" in output.read_text() or process.poll() is not None, "the bridge")
    match = re.search(r"ws://127\.0\.0\.1:\d+", output.read_text())
    assert match, process.said
    yield process, match[0]


def test_a_viewer_sees_the_samples_of_the_loop_bit_for_bit_and_the_bridge_ends_on_ctrl_c(
    graph: Graph, bridge: tuple[Any, str]
) -> None:
    process, address = bridge
    graph.start(COMPOSED)
    bearing = Bearing(graph)
    viewer = Viewer(address)
    try:
        graph.wait_until(lambda: STATE in viewer.channels, "the channel of the latched state")
        bearing.run(0)  # until paused
        graph.wait_until(lambda: viewer.of(TELEMETRY) and viewer.of("/amb/spectrum"), "samples and a spectrum")
        assert graph.call(Pause, "/amb/simulator/pause").success
    finally:
        viewer.close()
    last = viewer.of(TELEMETRY)[-1][1].step
    graph.wait_until(lambda: bearing.blocks[-1].first_step >= last - 100, "the telemetry that the viewer has seen")
    seen = [(stamp, message) for stamp, message in viewer.of(TELEMETRY) if np.isfinite(message.x.position)]
    steps = [message.step for _, message in seen]
    assert steps == sorted(set(steps))
    assert [stamp for stamp, _ in seen] == [100_000 * step for step in steps]
    there = {}
    for block in bearing.blocks:
        for axis in block.axes:
            for name in ("reference", "position", "current"):
                values = getattr(axis, name)
                there |= {(block.first_step + index, axis.name, name): value for index, value in enumerate(values)}
    for _, message in seen:
        for axis in "xy":
            for name in ("reference", "position", "current"):
                assert getattr(getattr(message, axis), name) == there[message.step, axis, name]
    assert {message.run for _, message in seen} == {bearing.blocks[-1].run}
    (information,) = [text for text in viewer.texts if text["op"] == "serverInfo"]
    assert information["capabilities"] == []  # nobody may publish, call services or set parameters
    process.send_signal(signal.SIGINT)
    graph.wait_until(lambda: process.poll() is not None, "the end of the bridge")
    assert process.poll() == 0


def test_a_port_that_is_taken_is_named(graph: Graph, bridge: tuple[Any, str]) -> None:
    port = bridge[1].rsplit(":", 1)[1]
    command = [str(find_executable("amb_bringup", "amb")), "foxglove", "--port", port]
    second = graph.start_command(command)
    graph.wait_until(lambda: second.poll() is not None, "the end of the second bridge")
    assert second.poll() == 1
    assert f"127.0.0.1, port {port}: cannot be bound" in second.said


def _decoder(channel: dict[str, Any]) -> Any:
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
    return lambda data: types.deserialize_cdr(data, channel["schemaName"])
