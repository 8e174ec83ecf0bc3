"""Node `recorder`: bags with the samples of the loop and everything that is needed to analyse them later.

It subscribes when it starts, so a recording need not wait for discovery. It keeps the last message of each latched
topic and writes it first into every bag. The ledger knows which messages a bag must contain.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription

from amb_core.ground.errors import AmbError, BagError, ParameterError, one_line
from amb_core.recording import BagWriter
from amb_core.recording.messages.loop_samples import steps_in
from amb_core.recording.messages.parameters import ParameterValue
from amb_ident_node.bag_in_progress import BagInProgress, require_free_space
from amb_ident_node.completeness import Mark
from amb_ident_node.departures import Departures
from amb_ident_node.ledger import Ledger
from amb_ident_node.publishers import Publishers
from amb_ident_node.readable import MessageReader
from amb_ident_node.recorded_topics import (
    OF_A_RUN,
    OF_THE_GRAPH,
    PARAMETER_EVENTS,
    RECORDED,
    RecordedTopic,
    end_of,
    monitor_progress,
)
from amb_ident_node.recorder_parameters import RecorderParameters
from amb_ident_node.stops import Stop, Stops
from amb_msgs.msg import LoopSamples, PlantState, SimulatorState
from amb_msgs.srv import GetState, StartRecording, StopRecording
from amb_ros import diagnostics, topics
from amb_ros.alarms import RecentProblem
from amb_ros.definitions import message_definition
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.requests import ask
from amb_ros.services import create_service
from amb_ros.subscriptions import create_subscription

WATCH_PERIOD = 0.5  # s, between looks for new nodes and publishers
LONGEST_PAUSE = 30.0  # s, between attempts to read the parameters of a node; the pause doubles each time


class RecorderNode(Node):
    """The recorder. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("recorder", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._settings = declare(self, RecorderParameters)
        self._recording: BagInProgress | None = None
        self._ledger = Ledger()
        self._departures = Departures()
        self._latched: dict[str, bytes] = {}
        self._plant_state: tuple[Mark, bytes] | None = None  # the last one
        self._in_trouble: BagInProgress | None = None  # the recording that was last reported for losing messages
        self._conflicts: dict[str, None] = {}  # seen while this bag was recorded
        self._published: set[str] = set()  # topics that had a publisher while this bag was recorded
        self._switching = threading.Lock()  # a message belongs either to a starting bag or to the time before it
        self._remote_parameters = RemoteParameters(self)
        self._described: set[str] = set()  # nodes whose parameters are in this bag
        self._attempts: Counter[str] = Counter()  # failed attempts to read those of a node
        self._next_attempt: dict[str, float] = {}  # in the steady clock (s)
        self._definitions = {topic.type_name: message_definition(topic.type_name) for topic in RECORDED}
        self._reader = MessageReader(self._definitions)
        self._refused_lately = RecentProblem()
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._stops = Stops()  # also those that wait for the worker
        self._stopped: tuple[BagInProgress, StopRecording.Response] | None = None  # the last recording, and the answer
        # One worker: a start and a stop never run at the same time.
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="recorder")
        self._topics = {self._full_name(topic.name): topic for topic in RECORDED}
        self._subscriptions_by_name = {name: self._subscribe(name, topic) for name, topic in self._topics.items()}
        self._sources = Publishers(self, self._topics, self._subscriptions_by_name)
        self._state_client = self.create_client(GetState, "simulator/get_state")
        create_service(self, StartRecording, "~/start", self._on_start, self._worker)
        create_service(self, StopRecording, "~/stop", self._on_stop, self._worker, self._on_stop_arrival)
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.TELEMETRY, topics.SIMULATOR_STATE)
        )
        self._watch_timer = self.create_timer(
            WATCH_PERIOD, self._on_watch_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        if self._settings.record_on_start:
            self._worker.submit(self._start_by_itself)

    def finish(self) -> None:
        """Close the bag; a waiting stop request returns."""
        self._ledger.end()
        self._departures.end()
        self._close()
        self._worker.shutdown()
        self._close()  # a start may have been in progress

    def _subscribe(self, name: str, topic: RecordedTopic) -> Subscription:
        create = partial(create_subscription, self) if topic.keeps_history else self.create_subscription
        subscription: Subscription = create(
            topic.type, name, partial(self._on_message, name), topic.requested, raw=True
        )
        return subscription

    def _full_name(self, topic: str) -> str:
        return self.resolve_topic_name(topics.clock(self.get_namespace()) if topic == topics.CLOCK else topic)

    # -- messages

    def _on_message(self, name: str, data: bytes) -> None:
        topic = self._topics[name]
        try:
            message = self._reader.read(topic, data)
        except AmbError as problem:
            self._refuse(topic.name, one_line(problem))
            return
        if topic.type is DiagnosticArray and not self._is_of_the_graph(message):
            return
        with self._switching:
            if topic.latched:
                self._latched[name] = data
            end = end_of(message)
            if topic.type is PlantState and end is not None:
                self._plant_state = end, data
            recording = self._recording
            steps = steps_in(message) if topic.type is LoopSamples else 0
            if recording is None or recording.write(name, data, end, steps):
                self._ledger.note(topic.name, message)
                return
            self._ledger.note_dropped(topic.name, message)
        if recording is not self._in_trouble:
            self._in_trouble = recording
            self._diagnostics.publish()

    def _refuse(self, topic: str, reason: str) -> None:
        self._ledger.note_refused(topic, reason)
        self.get_logger().error(f"a message on {topic} is not recorded: {reason}", throttle_duration_sec=5.0)
        if self._refused_lately.note(f"a message on {topic} was refused: {reason}"):
            self._diagnostics.publish()

    def _is_of_the_graph(self, array: DiagnosticArray) -> bool:
        """Whether diagnostics are of nodes in this namespace. Those of the region monitor report its progress."""
        prefix = self.get_namespace().strip("/") + "/"
        for status in array.status:
            values = {item.key: item.value for item in status.values}
            if status.name.startswith(prefix) and (progress := monitor_progress(values)):
                self._ledger.note_monitor(*progress)
            if instance := values.get(diagnostics.INSTANCE):
                self._departures.note_report(f"/{status.name}", instance, self._now(), self._ledger.within_run)
        return any(status.name.startswith(prefix) for status in array.status)

    def _now(self) -> str:
        return diagnostics.as_text(self._wall_clock.now().nanoseconds)

    def _on_watch_timer(self) -> None:
        self._departures.note_period(self._sources.nodes_of(OF_A_RUN), self._now(), self._ledger.within_run)
        if self._recording is not None:
            self._note_published()
            now = time.monotonic()
            late = [name for name in self._undescribed_nodes() if now >= self._next_attempt.get(name, now)]
            if late:
                # One attempt at a time: the worker also serves requests, which would wait behind the others.
                self._next_attempt.update(dict.fromkeys(late, math.inf))
                self._worker.submit(self._describe, late)

    # -- services, in the worker

    def _on_start(self, request: StartRecording.Request, response: StartRecording.Response) -> StartRecording.Response:
        response.uri = str(self._start(request.uri))
        response.success = True
        return response

    def _on_stop_arrival(self, request: StopRecording.Request) -> tuple[Stop]:
        stop = self._stops.arrive(request, self._recording)
        self._ledger.wake()  # a stop does not wait behind another one
        return (stop,)

    def _on_stop(
        self, request: StopRecording.Request, response: StopRecording.Response, stop: Stop
    ) -> StopRecording.Response:
        self._stops.require(stop)
        try:
            if self._stopped is not None and self._stopped[0] is stop.recording:  # by a stop before this one
                return self._stopped[1]
            recording = self._recording
            if recording is None:
                raise BagError(self._nothing_to_stop())
            self._stop(recording, response)
            self._stopped = recording, response
            return response
        finally:
            self._stops.answered(stop)

    def _nothing_to_stop(self) -> str:
        if namesakes := self._diagnostics.namesakes():
            return f"{namesakes}; process {os.getpid()} records nothing, another one may have closed its bag"
        return "nothing is being recorded; call ~/start first"

    def _stop(self, recording: BagInProgress, response: StopRecording.Response) -> None:
        self._note_published()
        awaited = self._wait_for_steps(recording)
        if self._ledger.within_run:
            self._departures.wait_for_signs()
        died = self._died()
        silent = self._describe_the_rest()
        self._note_conflicts()
        with self._switching:
            recording.end()
            lacks = self._ledger.lacks(awaited, self._published)
        recording.close()  # takes as long as the disk needs for what waits
        self._recording = None
        problems = [recording.trouble] if recording.trouble else []
        problems += died
        problems += [] if recording.failure else lacks
        problems += self._conflicts
        if silent:
            problems.append(f"the parameters of {', '.join(silent)} are missing")
        response.success = not problems
        response.message = "; ".join(problems)
        response.uri = str(recording.folder)
        response.messages = recording.messages

    def _wait_for_steps(self, recording: BagInProgress) -> Mark | None:
        """Wait up to the step that the newest stop awaits, which is returned; None if it cannot be known."""
        while True:
            newest = self._stops.newest
            awaited = self._awaited(newest.request.wait_for_run, newest.request.wait_for_step)
            if awaited is not None and not recording.failure:
                self._ledger.wait_for(
                    awaited,
                    self._published,
                    self._stops.time_left,
                    lambda newest=newest: bool(recording.failure) or self._stops.newest is not newest,  # type: ignore[misc]
                )
            if self._stops.newest is newest:
                return awaited

    def _start(self, uri: str) -> Path:
        """Start a bag.

        Raises
        ------
        BagError
            If a recording is in progress already, or this bag cannot be created.
        """
        if self._recording is not None:
            raise BagError(f"already recording {self._recording.folder}; stop that first")
        folder = Path(self._settings.directory).expanduser() / (uri or time.strftime("amb_%Y-%m-%d_%H-%M-%S"))
        require_free_space(folder, self._settings.minimum_free_space)
        self._sources.wait_for()
        self._described.clear()
        self._attempts.clear()
        self._next_attempt.clear()
        parameters = self._read_parameters(self._undescribed_nodes())
        recording = self._open(folder)
        with self._switching:
            self._conflicts.clear()
            self._ledger.start()
            self._departures.start()
            self._published.clear()
            first = dict(self._latched)
            self._recording = recording  # from here on it is closed, whatever fails
        self._note_published()
        self._begin(recording, first)
        for node, values in parameters.items():
            recording.write_parameters(PARAMETER_EVENTS, node, values)
        recording.flush()
        if recording.failure:  # a disk on which nothing can be written
            recording.discard()
            self._recording = None
            raise BagError(recording.failure)
        self.get_logger().info(f"recording {recording.folder}")
        return recording.folder

    def _open(self, folder: Path) -> BagInProgress:
        """An empty bag with all topics."""
        offered = {name: self._sources.offered(name) for name in self._topics}
        settings = self._settings
        writer = BagWriter(folder, settings.chunk_period, settings.split_size, settings.split_period)
        for name, topic in self._topics.items():
            writer.add_topic(name, topic.type_name, self._definitions[topic.type_name], offered[name])
        return BagInProgress(
            writer,
            settings.chunk_period,
            settings.queue_size,
            [name for name, topic in self._topics.items() if topic.latched],
            partial(require_free_space, folder, settings.minimum_free_space),
        )

    def _begin(self, recording: BagInProgress, first: dict[str, bytes]) -> None:
        """Determine the run and step at which the recording begins, and write the current states."""
        state = self._ask_for_state()
        exact = state is not None
        if state is None:
            state = self._ledger.state
            exact = state is not None and state.mode == SimulatorState.PAUSED
        origin = None if state is None else Mark(state.run, state.step if exact else 0)
        with self._switching:
            # The plant state of the simulator's present step was published when the simulator reached that step.
            if origin is not None and self._plant_state is not None:
                end, data = self._plant_state
                if end == Mark(origin.run, origin.step + 1):
                    first[self.resolve_topic_name(topics.PLANT_STATE)] = data
            self._ledger.begin(origin if exact else None)
            recording.begin(origin, first)

    def _awaited(self, run: int, step: int) -> Mark | None:
        """The place in a run up to which a recording must contain everything; None if it cannot be known."""
        now = self._ask_for_state() or self._ledger.state
        run = run or (now.run if now is not None else self._ledger.last_run)
        if not step and now is not None and run == now.run:
            step = now.step
        return Mark(run, step) if step else None

    def _ask_for_state(self) -> SimulatorState | None:
        """The present state of the simulator, as it reports it; None without an answer."""
        if not self._state_client.service_is_ready():
            return None
        answer = ask(self._state_client, GetState.Request(), self._settings.parameter_timeout)
        if answer is None or not answer.success:
            return None
        self._ledger.learn(answer.state)
        return answer.state

    def _note_published(self) -> None:
        """Note which of the topics that follow the steps of a run have a publisher.

        Topics that had one earlier count as well: a recorder that was blocked for long does not see their publishers
        for a while, and misses their messages.
        """
        self._published |= {name for name in OF_THE_GRAPH if self.count_publishers(self._full_name(name))}
        if self._ledger.has_monitor:
            self._published.add(topics.REGION)

    def _died(self) -> list[str]:
        """Which nodes died while a run was in progress, and up to where its telemetry is known."""
        died = self._departures.died(self._ledger.within_run)
        return [*died, self._ledger.end_of_telemetry] if died else []

    def _note_conflicts(self) -> None:
        conflicts = [self._ledger.conflict, *self._diagnostics.conflicts()]
        self._conflicts.update((text, None) for text in conflicts if text)

    def _start_by_itself(self) -> None:
        try:
            self._start("")
        except AmbError as problem:
            self.get_logger().error(one_line(problem))

    def _undescribed_nodes(self) -> list[str]:
        """Nodes of the workbench without parameters in the bag."""
        return [name for name in self._remote_parameters.nodes() if name not in self._described]

    def _read_parameters(
        self, nodes: Iterable[str], timeout: float | None = None, for_a_stop: bool = False
    ) -> dict[str, dict[str, ParameterValue]]:
        """The parameters of nodes, where available; no more of them once a stop waits for the worker.

        Reading them also proves that those nodes have discovered this one, so nothing that they publish is missed.
        """
        parameters = {}
        for name in nodes:
            if name in self._described:
                continue
            if self._stops and not for_a_stop:  # which reads them itself
                break
            try:
                parameters[name] = self._remote_parameters.read(name, timeout or self._settings.parameter_timeout)
                self._described.add(name)
            except ParameterError as problem:
                self._attempts[name] += 1
                self._next_attempt[name] = time.monotonic() + min(2.0 ** self._attempts[name], LONGEST_PAUSE)
                self.get_logger().warning(f"{one_line(problem)} They are missing from the bag.")
        return parameters

    def _describe_the_rest(self) -> list[str]:
        """Describe all nodes for a stop, also those that are discovered meanwhile; returns those that do not answer."""
        asked: set[str] = set()
        while new := set(self._undescribed_nodes()) - asked:
            for name in sorted(new):
                self._describe([name], max(self._stops.time_left, self._settings.parameter_timeout), for_a_stop=True)
            asked |= new
        return sorted(asked - self._described)

    def _describe(self, nodes: Iterable[str], timeout: float | None = None, for_a_stop: bool = False) -> None:
        """Write the parameters of nodes that are missing from the bag, such as those that started after it."""
        recording = self._recording
        if recording is not None:
            for node, values in self._read_parameters(nodes, timeout, for_a_stop).items():
                recording.write_parameters(PARAMETER_EVENTS, node, values)

    def _close(self) -> None:
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.close()
            if recording.trouble:
                self.get_logger().error(recording.trouble)

    # -- health

    def _report(self) -> diagnostics.Report:
        recording = self._recording
        if recording is None:
            refused = self._refused_lately.text
            if refused:
                return diagnostics.WARN, f"not recording; {refused}", {}
            return diagnostics.OK, "not recording", {}
        self._note_conflicts()
        lacks = self._ledger.lacks()
        waiting, size = recording.queued
        dropped = recording.dropped.values()
        values = {
            "bag": recording.folder,
            "messages": recording.messages,
            "queued messages": waiting,
            "queue (B)": size,
            "dropped messages": sum(loss.messages for loss in dropped),
            "dropped steps": sum(loss.steps for loss in dropped),
            "topics with gaps": len(lacks),
        }
        if recording.trouble:
            return diagnostics.ERROR, recording.trouble, values
        if self._ledger.conflict:
            return diagnostics.ERROR, self._ledger.conflict, values
        if died := self._died():
            return diagnostics.ERROR, "; ".join(died), values
        if lacks:
            return diagnostics.WARN, "; ".join(lacks), values
        return diagnostics.OK, "closing the bag" if recording.ended else "recording", values


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(RecorderNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
