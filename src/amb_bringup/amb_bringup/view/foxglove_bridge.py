"""A running graph for Foxglove: its samples and states over Foxglove's websocket protocol, which the package
foxglove-sdk serves.

The messages are those of `amb bag export --foxglove`. Telemetry is heard without repetition (best effort) and passed on
from buffers of bounded length, so neither a slow bridge nor a slow viewer can slow the loop down: what does not fit is
lost, and shows as a gap.
"""

from __future__ import annotations

import importlib
import threading
from collections.abc import Callable
from typing import Any

from rclpy.serialization import serialize_message

from amb_bringup.view.listener import GraphListener
from amb_core.ground.errors import AmbError, BagError
from amb_core.loop.records import LoopRecord
from amb_core.recording.content import REGION_STATE, SIMULATOR_STATE
from amb_core.recording.export.axis_messages import SAMPLE, SPECTRUM, AxisMessages
from amb_core.recording.export.foxglove import SPECTRUM_TOPIC, STATES, TELEMETRY_TOPIC, samples_with_gap
from amb_core.recording.export.message_types import step_times
from amb_core.recording.export.spectra import RunSpectra
from amb_core.recording.export.status import BRIDGE_STATE
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.time_stamp import LONGEST_TIME
from amb_ros import topics
from amb_ros.definitions import message_definition

PERIOD = 0.03  # s, between two looks at what has arrived
BACKLOG = 20_000  # messages that wait for a viewer: two seconds of samples at 10 kHz
KINDS = {topics.REGION: REGION_STATE, topics.SIMULATOR_STATE: SIMULATOR_STATE, topics.BRIDGE_STATE: BRIDGE_STATE}
"""Message types of the states that are passed on as they are, by their topics."""


class BridgeError(AmbError):
    """The graph cannot be shown in Foxglove."""


class FoxgloveBridge:
    """The server and what it sends.

    Parameters
    ----------
    host : str
        Address to bind to.
    port : int
        Port; 0 for any free one.
    report : callable
        Takes what is wrong with messages of the graph, a line for each new problem.

    Attributes
    ----------
    address : str
        What Foxglove is to open.

    Raises
    ------
    BridgeError
        If foxglove-sdk is not installed, or address and port cannot be bound.
    """

    def __init__(self, host: str, port: int, report: Callable[[str], None]) -> None:
        self._sdk = _foxglove_sdk()
        self._context = self._sdk.Context()
        try:
            self._server = self._sdk.start_server(
                name="amb", host=host, port=port, context=self._context, message_backlog_size=BACKLOG
            )
        except Exception as problem:  # the package has one kind of error for all
            raise BridgeError(f"{host}, port {port}: cannot be bound: {problem}; give another --port") from None
        name = f"[{host}]" if ":" in host else host
        self.address = f"ws://{name}:{self._server.port}"
        self._report, self._problem = report, ""
        self._channels: dict[str, Any] = {}
        self._samples: _Samples | None = None
        self._sample_time = 0.0

    def serve(self, ended: threading.Event) -> None:
        """Pass on what the graph in the DDS domain of this process publishes, until `ended` is set."""
        listener = GraphListener()
        try:
            while not ended.wait(PERIOD):
                for _ in range(len(listener.messages)):
                    topic, message, _ = listener.messages.popleft()
                    self._take(topic, message)
        finally:
            listener.close()
            self._server.stop()

    def _take(self, topic: str, message: Any) -> None:
        if topic == topics.TELEMETRY:
            try:
                self._take_samples(int(message.run), block_from_message(message))
            except BagError as problem:
                if str(problem) != self._problem:
                    self._problem = str(problem)
                    self._report(self._problem)
        elif topic in KINDS:
            self._take_state(KINDS[topic], message, getattr(message, "sample_time", self._sample_time))

    def _take_state(self, kind: str, message: Any, sample_time: float) -> None:
        time = log_time(message.step, sample_time)
        if time is None:
            return
        channel = self._channel(STATES[kind], kind, lambda: message_definition(kind))
        channel.log(serialize_message(message), log_time=time)

    def _take_samples(self, run: int, block: LoopRecord) -> None:
        samples = self._samples
        if samples is None or (samples.run, samples.axes, samples.sample_time) != (run, block.axes, block.sample_time):
            if samples is None or samples.axes != block.axes:  # then the messages have other fields
                for topic in (TELEMETRY_TOPIC, SPECTRUM_TOPIC):
                    if topic in self._channels:
                        self._channels.pop(topic).close()
            samples = self._samples = _Samples(run, block)
            self._sample_time = block.sample_time
        types = samples.messages.types
        for topic, kind, messages in samples.add(block):
            channel = self._channel(topic, kind, lambda kind=kind: types.definition(kind))  # type: ignore[misc]
            if channel.has_sinks():
                for time, data in messages():
                    channel.log(data, log_time=time)

    def _channel(self, topic: str, kind: str, definition: Callable[[], str]) -> Any:
        if topic not in self._channels:
            schema = self._sdk.Schema(name=kind, encoding="ros2msg", data=definition().encode())
            self._channels[topic] = self._sdk.Channel(
                topic, schema=schema, message_encoding="cdr", context=self._context
            )
        return self._channels[topic]


def log_time(step: int, sample_time: float) -> int | None:
    """Time of a step (ns) at a sample time (s); None for a time that no run has.

    So it is with the state of a bridge that is not configured, with a region whose run is not known yet, and with what
    anybody may publish.
    """
    runs = sample_time > 0.0 and step * sample_time <= LONGEST_TIME
    return int(step_times(step, sample_time)) if runs else None


class _Samples:
    """The samples of one run, in order and each once."""

    def __init__(self, run: int, block: LoopRecord) -> None:
        self.run, self.axes, self.sample_time = run, block.axes, block.sample_time
        self.messages = AxisMessages(block.axes)
        self._spectra = RunSpectra(len(block.axes), block.sample_time)
        self._next = block.first_step

    def add(self, block: LoopRecord) -> list[tuple[str, str, Callable[[], list[tuple[int, bytes]]]]]:
        """What the next block gives to send: topic, type, and a function that makes times (ns) and messages."""
        stop, gap = block.first_step + block.steps, None
        if stop <= self._next:
            return []  # came before
        if block.first_step < self._next:
            block = block.window(self._next, stop - self._next)
        elif block.first_step > self._next:
            gap = self._next
        self._next = stop
        spectra = list(self._spectra.add(block))

        def samples() -> list[tuple[int, bytes]]:
            parts = samples_with_gap(self.messages, self.run, block, gap)
            return [pair for times, data in parts for pair in zip(times.tolist(), data, strict=True)]

        def spectrum() -> list[tuple[int, bytes]]:
            times = [int(step_times(one.step - 1, self.sample_time)) for one in spectra]
            return [(time, self.messages.spectrum(time, one)) for time, one in zip(times, spectra, strict=True)]

        return [(TELEMETRY_TOPIC, SAMPLE, samples), (SPECTRUM_TOPIC, SPECTRUM, spectrum)]


def _foxglove_sdk() -> Any:
    """The package, which is an extra."""
    try:
        return importlib.import_module("foxglove")
    except ImportError:
        raise BridgeError("foxglove-sdk is not installed; add it with make setup EXTRAS=foxglove") from None
