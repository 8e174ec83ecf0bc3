"""Node `recorder`: a bag of what the loop did and of all that is needed to understand it later.

It listens from its start on, so that a recording begins without the time that discovery takes, and keeps the last
message of latched topics to put it first into every bag.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from amb_core.bags import BagWriter
from amb_core.errors import AmbError, BagError, ParameterError
from amb_core.messages import ParameterValue
from amb_core.parameters import Parameters, choice, quantity, switch
from amb_ident_node.recording import Recording
from amb_msgs.msg import (
    Excitation,
    ExcitationStatus,
    LoopSamples,
    PlantState,
    RegionMap,
    RegionState,
    SimulatorState,
    StateSpaceModel,
)
from amb_msgs.srv import StartRecording, StopRecording
from amb_ros import diagnostics, topics
from amb_ros.definitions import message_definition
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, STREAM
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.services import create_service

PARAMETER_EVENTS = "/parameter_events"
DISCOVERY_TIMEOUT = 2.0  # s
READING_ATTEMPTS = 3  # to read the parameters of a node, before the last one at the end of the bag
DEFAULT_STOP_TIMEOUT = 10.0  # s
LONGEST_STOP_TIMEOUT = 3600.0  # s


class RecorderParameters(Parameters):
    """Parameters of the node."""

    directory: str = choice("bags", "folder for bags that are asked for without a path or with a relative one")
    record_on_start: bool = switch(False, "start a bag named by date as soon as the node is up")
    chunk_period: float = quantity(
        0.5, "s", "period of writing to the disk: what a killed recorder may lose", 0.05, 10.0
    )
    parameter_timeout: float = quantity(
        2.0, "s", "longest wait for an answer about the parameters of a node", 0.05, 10.0
    )


class RecordedTopic(NamedTuple):
    """A topic to record."""

    name: str
    type: Any
    latched: bool = False
    stream: QoSProfile = STREAM

    @property
    def type_name(self) -> str:
        """As `package/msg/Name`."""
        return f"{self.type.__module__.split('.')[0]}/msg/{self.type.__name__}"

    @property
    def qos(self) -> QoSProfile:
        """As the publishers offer it, with room for a burst."""
        return EVERY_STATE if self.latched else self.stream


RECORDED = (
    RecordedTopic(topics.TELEMETRY, LoopSamples, stream=HISTORY),
    RecordedTopic(topics.PLANT_STATE, PlantState, stream=HISTORY),
    RecordedTopic(topics.EXCITATION, Excitation, latched=True),
    RecordedTopic(topics.EXCITATION_STATUS, ExcitationStatus, latched=True),
    RecordedTopic(topics.REGION, RegionState, stream=HISTORY),
    RecordedTopic(topics.REGION_MAP, RegionMap, latched=True),
    RecordedTopic(topics.MODEL, StateSpaceModel, latched=True),
    RecordedTopic(topics.SIMULATOR_STATE, SimulatorState, latched=True),
    RecordedTopic(PARAMETER_EVENTS, ParameterEvent),
    RecordedTopic("/rosout", Log),
    RecordedTopic("/diagnostics", DiagnosticArray),
)


class RecorderNode(Node):
    """The recorder. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("recorder", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._settings = declare(self, RecorderParameters)
        self._recording: Recording | None = None
        self._latched: dict[str, bytes] = {}
        self._switching = threading.Lock()  # a message falls either before or into a bag that starts
        self._remote_parameters = RemoteParameters(self)
        self._described: set[str] = set()  # nodes whose parameters are in this bag
        self._attempts: Counter[str] = Counter()  # in vain, to read those of a node
        self._definitions = {topic.type_name: message_definition(topic.type_name) for topic in RECORDED}
        # One worker: a start and a stop never run at the same time.
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="recorder")
        self._topics = {self.resolve_topic_name(topic.name): topic for topic in RECORDED}
        self._subscriptions_by_name = {
            name: self.create_subscription(topic.type, name, partial(self._on_message, name), topic.qos, raw=True)
            for name, topic in self._topics.items()
        }
        create_service(self, StartRecording, "~/start", self._on_start, self._worker)
        create_service(self, StopRecording, "~/stop", self._on_stop, self._worker)
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report)
        self._flush_timer = self.create_timer(
            self._settings.chunk_period, self._on_flush_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        if self._settings.record_on_start:
            self._worker.submit(self._start_by_itself)

    def destroy_node(self) -> None:
        """Close the bag, then the node."""
        self._close()
        self._worker.shutdown()
        self._close()  # a start may have been under way
        super().destroy_node()

    # -- messages

    def _on_message(self, name: str, data: bytes) -> None:
        topic = self._topics[name]
        with self._switching:
            if topic.latched:
                self._latched[name] = data
            recording = self._recording
            if recording is None:
                return
            recording.write(name, data)
        if topic.type is LoopSamples:
            block = deserialize_message(data, LoopSamples)
            recording.note_telemetry(block.run, block.first_step, len(block.position_x))

    def _on_flush_timer(self) -> None:
        if self._recording is not None:
            self._recording.flush()
            late = [name for name in self._undescribed_nodes() if self._attempts[name] < READING_ATTEMPTS]
            if late:
                self._worker.submit(self._describe, late)

    # -- services, in the worker

    def _on_start(self, request: StartRecording.Request, response: StartRecording.Response) -> StartRecording.Response:
        response.uri = str(self._start(request.uri))
        response.success = True
        return response

    def _on_stop(self, request: StopRecording.Request, response: StopRecording.Response) -> StopRecording.Response:
        recording = self._recording
        if recording is None:
            raise BagError("nothing is being recorded; call ~/start first")
        if not 0.0 <= request.timeout <= LONGEST_STOP_TIMEOUT:
            raise BagError(
                f"timeout = {request.timeout} s is not allowed; allowed: 0 (for {DEFAULT_STOP_TIMEOUT:g} s) "
                f"to {LONGEST_STOP_TIMEOUT:g} s"
            )
        awaited = None
        if request.wait_for_step:
            awaited = (request.wait_for_run, request.wait_for_step)
            recording.wait_for(*awaited, request.timeout or DEFAULT_STOP_TIMEOUT)
        self._describe(self._undescribed_nodes())
        problems = [recording.failure] if recording.failure else recording.gaps(awaited)
        if missing := self._undescribed_nodes():
            problems.append(f"the parameters of {', '.join(missing)} are missing")
        self._recording = None
        try:
            recording.close()
        except BagError as problem:
            problems = [str(problem)]
        response.success = not problems
        response.message = "; ".join(problems)
        response.uri = str(recording.folder)
        response.messages = recording.messages
        return response

    def _start(self, uri: str) -> Path:
        """Start a bag.

        Raises
        ------
        BagError
            If one is being recorded already, or this one cannot be made.
        """
        if self._recording is not None:
            raise BagError(f"already recording {self._recording.folder}; stop that first")
        folder = Path(self._settings.directory).expanduser() / (uri or time.strftime("amb_%Y-%m-%d_%H-%M-%S"))
        self._wait_for_publishers()
        self._described.clear()
        self._attempts.clear()
        parameters = self._read_parameters(self._undescribed_nodes())
        writer = BagWriter(folder, self._settings.chunk_period)
        for name, topic in self._topics.items():
            writer.add_topic(name, topic.type_name, self._definitions[topic.type_name], topic.latched)
        with self._switching:
            recording = Recording(writer, self._paused_at())
            for name, data in self._latched.items():
                recording.write(name, data)
            for node, values in parameters.items():
                recording.write_parameters(PARAMETER_EVENTS, node, values)
            self._recording = recording
        self.get_logger().info(f"recording {writer.folder}")
        return writer.folder

    def _start_by_itself(self) -> None:
        try:
            self._start("")
        except AmbError as problem:
            self.get_logger().error(str(problem))

    def _wait_for_publishers(self) -> None:
        """Wait until controller and simulator publish and the publishers that exist are connected."""
        deadline = time.monotonic() + DISCOVERY_TIMEOUT
        expected = [self.resolve_topic_name(name) for name in (topics.TELEMETRY, topics.SIMULATOR_STATE)]
        while not all(map(self.count_publishers, expected)) and time.monotonic() < deadline:
            time.sleep(0.01)
        while (waiting := self._unconnected_topics()) and time.monotonic() < deadline:
            time.sleep(0.01)
        for name in waiting:
            self.get_logger().warning(f"not connected to every publisher of {name}; do their QoS settings fit?")

    def _unconnected_topics(self) -> list[str]:
        """Topics with publishers that have not been matched with the subscription."""
        return [
            name
            for name, subscription in self._subscriptions_by_name.items()
            if subscription.get_publisher_count() < self.count_publishers(name)
        ]

    def _undescribed_nodes(self) -> list[str]:
        """Those nodes of the workbench whose parameters the bag lacks."""
        return [name for name in self._remote_parameters.nodes() if name not in self._described]

    def _read_parameters(self, nodes: Iterable[str]) -> dict[str, dict[str, ParameterValue]]:
        """The parameters of nodes, as far as they tell them.

        Reading them also proves that those nodes have heard of this one, and so that nothing they publish is missed.
        """
        parameters = {}
        for name in nodes:
            if name in self._described:
                continue
            try:
                parameters[name] = self._remote_parameters.read(name, self._settings.parameter_timeout)
                self._described.add(name)
            except ParameterError as problem:
                self._attempts[name] += 1
                self.get_logger().warning(f"{problem} The bag lacks them.")
        return parameters

    def _describe(self, nodes: Iterable[str]) -> None:
        """Write the parameters of nodes that the bag lacks so far, such as of those that started after it."""
        recording = self._recording
        if recording is not None:
            for node, values in self._read_parameters(nodes).items():
                recording.write_parameters(PARAMETER_EVENTS, node, values)

    def _paused_at(self) -> tuple[int, int] | None:
        """Run and step at which the simulator stands still, None if it is not known to."""
        data = self._latched.get(self.resolve_topic_name(topics.SIMULATOR_STATE))
        if data is None:
            return None
        state = deserialize_message(data, SimulatorState)
        return (state.run, state.step) if state.mode == SimulatorState.PAUSED else None

    def _close(self) -> None:
        recording, self._recording = self._recording, None
        if recording is not None:
            try:
                recording.close()
            except BagError as problem:
                self.get_logger().error(str(problem))

    # -- health

    def _report(self) -> diagnostics.Report:
        recording = self._recording
        if recording is None:
            return diagnostics.OK, "not recording", {}
        gaps = recording.gaps()
        values = {"bag": recording.folder, "messages": recording.messages, "runs with gaps": len(gaps)}
        if recording.failure:
            return diagnostics.ERROR, recording.failure, values
        if gaps:
            return diagnostics.WARN, "; ".join(gaps), values
        return diagnostics.OK, "recording", values


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(RecorderNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
