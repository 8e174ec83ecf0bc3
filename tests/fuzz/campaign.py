"""A campaign of hostile messages against the whole running graph: what died, what failed inside, what grew."""

from __future__ import annotations

import contextlib
import math
import shutil
import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameterTypes, ListParameters
from rclpy.action import ActionClient
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from amb_bringup.client import NODES
from amb_bringup.client.errors import ClientError
from amb_msgs.msg import SimulatorState
from amb_msgs.srv import Pause, Reset, RunSteps, StopRecording
from amb_ros.qos import LATCHED
from amb_ros.requests import QUICKLY, PendingRequest
from tests.fuzz.attacked_graph import ANSWER_TIMEOUT, NAMESPACE, AttackedGraph
from tests.fuzz.hostile import Hostile, make_traps
from tests.fuzz.targets import Target, find_targets, shown, tame, valid_messages

WARM_UP = 0.5  # share of the campaign before the memory counts: code that is loaded on demand is no leak
STACKS = 5.0  # s for a node that does not answer to write where its threads are
RECENT = 20  # cases among which the cause of a death is looked for
SETTLING_TIME = 1.0  # s without news after which the graph counts as discovered
HOUSEKEEPING = 50  # cases between a pause, a reset and the end of a recording
READING = ("/describe_parameters", "/get_parameters", "/get_parameter_types", "/list_parameters")
"""Services of rclpy that change nothing: asked again, as their answer to a client that they discover late is lost."""
ANYONE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass
class Finding:
    """What a case led to; the case and the seed make its message again."""

    kind: str  # death or internal_error
    node: str
    case: int
    target: str
    message: str
    what: str


@dataclass
class Outcome:
    """Counts of one campaign."""

    seed: int
    check_fields: bool
    requests: int = 0
    messages: int = 0
    parameters: int = 0
    seconds: float = 0.0
    growth: dict[str, float] = field(default_factory=dict)  # percent, by node
    sent: dict[str, int] = field(default_factory=dict)  # by target
    findings: list[Finding] = field(default_factory=list)

    def count(self, kind: str) -> int:
        """Number of findings of a kind."""
        return sum(finding.kind == kind for finding in self.findings)

    @property
    def memory_growth_percent(self) -> float:
        """That of the node that grew most; 0 where none did."""
        return max([0.0, *self.growth.values()])

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        counts = {"deaths": self.count("death"), "internal_errors": self.count("internal_error")}
        return asdict(self) | counts | {"memory_growth_percent": self.memory_growth_percent}


class Campaign:
    """Sends cases to a graph and notes what they do to it."""

    def __init__(self, graph: AttackedGraph, folder: Path, outcome: Outcome) -> None:
        self.outcome = outcome
        self._graph, self._nodes, self._connection = graph, graph.nodes, graph.connection
        traps = folder / "traps"
        traps.mkdir()
        self._traps = make_traps(traps)
        self._state = SimulatorState()
        self._connection.node.create_subscription(SimulatorState, "simulator/state", self._on_state, LATCHED)
        self._clients: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}
        self._recent: deque[tuple[int, Target]] = deque(maxlen=RECENT)
        self._bare: dict[str, int] = {}  # memory of the nodes after the warm-up (bytes)
        for name in NODES:
            graph.limit_memory(name)
            self._probe(name)
        self.targets = self._discover()
        self._weights = [target.weight for target in self.targets]
        self._parameters = sorted({name for node in NODES for name in self._names_of(node)})

    def run(self, share: Callable[[int], float], first: int, progress: Callable[[str], None]) -> None:
        """Send case after case from `first` on, as long as the share of the campaign that is done is below 1.

        Parameters
        ----------
        share : callable
            Gives that share for the number of cases sent.
        first : int
            Number of the first case.
        progress : callable
            Called with a line on how far it is.
        """
        began, sent = time.monotonic(), 0
        while (done := share(sent)) < 1.0:
            if sent % HOUSEKEEPING == 0:
                self._keep_house()
                progress(f"case {first + sent}, {100.0 * done:.0f} %, {len(self.outcome.findings)} findings")
            if done >= WARM_UP and not self._bare:
                self._bare = self._graph.memory()
            self.send(first + sent)
            sent += 1
        self._keep_house()
        for name, now in self._graph.memory().items():
            if name in self._bare:
                self.outcome.growth[name] = round(100.0 * (now / self._bare[name] - 1.0), 2)
        self.outcome.seconds = round(time.monotonic() - began, 1)

    def send(self, case: int) -> None:
        """Send the message of a case, and note what it does to the nodes behind its target."""
        hostile = Hostile(np.random.default_rng([self.outcome.seed, case]), (*self._traps, *self._parameters))
        target = hostile.choose(self.targets, self._weights)
        message = self._message(hostile, target)
        self.outcome.sent[target.name] = self.outcome.sent.get(target.name, 0) + 1
        self._recent.append((case, target))
        note = _Note(self.outcome, case, target, message)
        try:
            {"topic": self._publish, "action": self._act}.get(target.kind, self._call)(target, message, note)
            for node in target.nodes:
                self._probe(node)
        except ClientError as problem:
            self._bury(target, note, str(problem))
        for node, lines in self._graph.errors.take().items():
            if not note.admitted:  # or the answer has said it already
                note.add("internal_error", node, "\n".join([*lines, *self._nodes.lines(node)[-20:]]))

    # -- the message of a case

    def _message(self, hostile: Hostile, target: Target) -> Any:
        name = target.name.removeprefix(f"/{NAMESPACE}/")
        known = valid_messages(self._state.run, self._state.step).get(name)
        kind = target.message_type
        message = hostile.near(kind, hostile.choose(known)) if known and hostile.chance(0.7) else hostile.message(kind)
        if target.kind == "parameters":
            for parameter in message.parameters:
                parameter.name = hostile.choose(self._parameters) if hostile.chance(0.8) else parameter.name
                parameter.value.type %= 10 if hostile.chance(0.9) else 256
        tame(name, message)
        if target.kind == "topic" and hostile.chance(0.1):
            return hostile.cut(serialize_message(message))
        return message

    def _call(self, target: Target, message: Any, note: _Note) -> None:
        if target.kind == "parameters":
            self.outcome.parameters += len(message.parameters)
        self.outcome.requests += 1
        answer = self._ask(target.type, target.name, message, target.name.endswith(READING))
        note.read(str(getattr(answer, "message", "")))
        if target.name.endswith("simulator/run") and answer.success:
            self._ask(Pause, f"/{NAMESPACE}/simulator/pause", Pause.Request())

    def _publish(self, target: Target, message: Any, _note: _Note) -> None:
        self.outcome.messages += 1
        if target.name not in self._publishers:
            publisher = self._connection.node.create_publisher(target.type, target.name, ANYONE)
            self._publishers[target.name] = publisher
            if target.nodes:
                self._wait(lambda: publisher.get_subscription_count() >= len(target.nodes), target.name)
        if target.name.endswith("/current_reference"):  # while paused it would be an answer to a step of the past
            self._ask(RunSteps, f"/{NAMESPACE}/simulator/run", RunSteps.Request(steps=1_000))
        if isinstance(message, bytes):  # as they are
            with contextlib.suppress(RuntimeError):  # more than the largest message of a type: the middleware refuses
                self._publishers[target.name].publish(message)
        else:
            self._publishers[target.name].publish(message)

    def _act(self, target: Target, message: Any, note: _Note) -> None:
        self.outcome.requests += 1
        if target.name not in self._clients:
            self._clients[target.name] = ActionClient(self._connection.node, target.type, target.name)
        client = self._clients[target.name]
        self._wait(client.server_is_ready, target.name)
        sent = client.send_goal_async(message)
        self._wait(sent.done, target.name)
        handle = sent.result()
        if handle.accepted:
            handle.cancel_goal_async()
            ended = handle.get_result_async()
            self._wait(ended.done, target.name)
            note.read(ended.result().result.message)

    # -- the nodes

    def _discover(self) -> list[Target]:
        """All doors of the nodes: discovery brings them in several messages, so wait until nothing new comes."""
        targets: list[Target] = []
        since = time.monotonic()

        def settled() -> bool:
            nonlocal targets, since
            try:
                now = find_targets(self._connection.node, NODES, f"/{NAMESPACE}")
            except NodeNameNonExistentError:
                now = []
            if now != targets:
                targets, since = now, time.monotonic()
            return bool(targets) and time.monotonic() - since > SETTLING_TIME

        try:
            self._wait(settled, "discovery")
        except ClientError as problem:
            known = ", ".join(sorted(self._connection.node_names())) or "none"
            raise ClientError(f"{problem}; nodes that are known: {known}; their doors: {len(targets)}") from None
        return targets

    def _ask(self, service: Any, name: str, request: Any, repeated: bool = False) -> Any:
        if name not in self._clients:
            self._clients[name] = self._connection.node.create_client(service, name)
        client = self._clients[name]
        self._wait(client.service_is_ready, name)
        pending, answer = PendingRequest(client, request, QUICKLY if repeated else math.inf), None

        def answered() -> bool:
            nonlocal answer
            answer = pending.answer()
            return answer is not None

        try:
            self._wait(answered, name)
        finally:
            pending.forget()
        return answer

    def _wait(self, condition: Callable[[], Any], name: str) -> None:
        """Wait for a condition; ClientError if it does not come, or as soon as a node has ended."""
        ended: list[str] = []

        def settled() -> bool:
            ended.extend(self._nodes.ended())
            return bool(ended) or bool(condition())

        self._connection.wait_until(settled, ANSWER_TIMEOUT, f"no answer of {name}")
        if ended:
            raise ClientError(f"{ended[0]} ended")

    def _probe(self, node: str) -> None:
        """See that a node answers; what was sent to it before has then been handled, or nearly so."""
        self._ask(GetParameterTypes, f"/{NAMESPACE}/{node}/get_parameter_types", GetParameterTypes.Request(), True)

    def _names_of(self, node: str) -> list[str]:
        answer = self._ask(ListParameters, f"/{NAMESPACE}/{node}/list_parameters", ListParameters.Request(), True)
        return list(answer.result.names)

    def _bury(self, target: Target, note: _Note, problem: str) -> None:
        """Note the nodes that have ended, or do not answer, and start them again."""
        ended = self._nodes.ended()
        if target.name in self._publishers:  # or the node that starts anew hears its last message at once
            self._connection.node.destroy_publisher(self._publishers.pop(target.name))
        for node in ended or target.nodes:
            what = f"exit code {ended[node]}" if node in ended else problem
            # A topic may be read after the probe was answered: the cause may be a case before this one.
            before = [f"case {case} on {earlier.name}" for case, earlier in self._recent if node in earlier.nodes]
            sent = f"sent to it: {', '.join(before)}"
            if node not in ended:
                what += f"; another request is {self._whether_answered(node)}"
            note.add("death", node, "\n".join([what, sent, *self._last_words(node)]))
            self._graph.restart(node)
            self._graph.limit_memory(node)
            self._bare.pop(node, None)  # a new process starts from nothing
            self._probe(node)
        self._graph.errors.take()  # they belong to the death

    def _whether_answered(self, node: str) -> str:
        """Whether a node answers now: if so, one answer of it was lost, and the node works."""
        try:
            self._probe(node)
        except ClientError:
            return "not answered"
        return "answered"

    def _last_words(self, node: str) -> list[str]:
        """The last lines of a node; with the stacks of its threads, which it writes on SIGUSR1, if it still runs."""
        before = self._nodes.lines(node)
        process = self._nodes.processes[node]
        if process.poll() is not None:
            return before[-20:]
        process.send_signal(signal.SIGUSR1)
        with contextlib.suppress(ClientError):
            self._connection.wait_until(lambda: len(self._nodes.lines(node)) > len(before) + 3, STACKS, "no stacks")
        return self._nodes.lines(node)

    def _keep_house(self) -> None:
        """Pause, start a new run, end the recording and remove its bag."""
        for service, name, request in (
            (Pause, "simulator/pause", Pause.Request()),
            (Reset, "simulator/reset", Reset.Request()),
            (RunSteps, "simulator/run", RunSteps.Request(steps=200)),
            (StopRecording, "recorder/stop", StopRecording.Request(timeout=0.1)),
        ):
            self._ask(service, f"/{NAMESPACE}/{name}", request)
        shutil.rmtree(self._graph.bags, ignore_errors=True)

    def _on_state(self, message: SimulatorState) -> None:
        self._state = message


class _Note:
    """Where a case writes its findings."""

    def __init__(self, outcome: Outcome, case: int, target: Target, message: Any) -> None:
        self._outcome, self._case, self._target, self._message = outcome, case, target, message
        self.admitted = False

    def add(self, kind: str, node: str, what: str) -> None:
        """Add a finding about a node."""
        self._outcome.findings.append(Finding(kind, node, self._case, self._target.name, shown(self._message), what))

    def read(self, answer: str) -> None:
        """Add a finding if an answer admits an internal error."""
        if "internal error" in answer:
            self.admitted = True
            self.add("internal_error", self._target.nodes[0], answer)
