"""The generator alone: what stays on its latched topic, and that a stop never waits for a start. The test controls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.srv import GetParameters

from amb_core.plant import PlantParameters
from amb_core.plant.machine import machine_of
from amb_msgs.msg import Excitation, ExcitationStatus, SimulatorState
from amb_msgs.srv import StartExcitation, StopExcitation
from amb_ros.qos import EVERY_STATE, LATCHED
from tests.graph.bearing import machine_message, machine_publisher

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.graph.conftest import Graph
    from tests.graph.processes import NodeProcess

GENERATOR = "amb_controller_node.excitation_generator"
RUN = 5
SQUARE = {"kind": "square", "amplitude": 1e-6, "axes": "x", "duration": 0.1, "frequency": 50.0}


class Controlled:
    """A generator, and a controller that answers as the test says."""

    def __init__(self, graph: Graph, answer_timeout: float = 60.0) -> None:
        self.graph, self._answer_timeout = graph, answer_timeout
        self.heard: list[Excitation] = []
        self.answers: Callable[[Excitation], bool | None] = lambda _: True
        node = graph.node
        self._machines = machine_publisher(node)
        self._machines.publish(machine_message(machine_of(PlantParameters())))
        self._states = node.create_publisher(SimulatorState, "/amb/simulator/state", EVERY_STATE)
        self._states.publish(SimulatorState(run=RUN))
        self._status = node.create_publisher(ExcitationStatus, "/amb/excitation_status", EVERY_STATE)
        node.create_subscription(Excitation, "/amb/excitation", self._on_excitation, EVERY_STATE)
        self._process = self._start_generator()
        self._start = node.create_client(StartExcitation, "/amb/excitation_generator/start")
        self._stop = node.create_client(StopExcitation, "/amb/excitation_generator/stop")
        graph.wait_until(self._status.get_subscription_count, "the generator")

    def _start_generator(self) -> NodeProcess:
        return self.graph.start(GENERATOR, parameters={"answer_timeout": self._answer_timeout})

    def start_anew(self) -> None:
        """End the generator and start another one."""
        self.graph.stop(self._process)
        self._process = self._start_generator()
        self.heard.clear()

    def _on_excitation(self, message: Excitation) -> None:
        if any((message.id, message.first_step) == (known.id, known.first_step) for known in self.heard):
            return
        again = any(message.id == known.id for known in self.heard)
        self.heard.append(message)
        accepted = self.answers(message)
        if accepted is not None and not again:
            self._status.publish(ExcitationStatus(run=RUN, id=message.id, accepted=accepted, first_step=7))

    def refuse(self, number: int, reason: str) -> None:
        """Answer an excitation of any time."""
        self._status.publish(ExcitationStatus(run=RUN, id=number, accepted=False, message=reason))

    def end(self, number: int) -> None:
        """Report that what plays has ended, by a stop of this number."""
        self._status.publish(ExcitationStatus(run=RUN, id=number, kind="stop", accepted=True, first_step=9))

    def asked(self) -> Any:
        """The response to a request."""
        start = self.ask_to_start()
        self.graph.wait_until(start.done, "the answer")
        return start.result()

    def ask_to_start(self) -> Any:
        """A request whose answer the test does not wait for."""
        self.graph.wait_until(self._start.service_is_ready, "the generator")
        return self._start.call_async(StartExcitation.Request(**SQUARE))

    def stop(self) -> Any:
        return self.graph.call(StopExcitation, "/amb/excitation_generator/stop")

    def ask_to_stop(self) -> Any:
        """A stop whose answer the test does not wait for."""
        return self._stop.call_async(StopExcitation.Request())

    def all_asked_has_arrived(self) -> None:
        """Wait until the generator has all requests so far: one after them is answered, by another service."""
        self.graph.call(GetParameters, "/amb/excitation_generator/get_parameters")

    def latched(self) -> Excitation:
        """What a controller gets that starts now."""
        late: list[Excitation] = []
        node = self.graph.node
        subscription = node.create_subscription(Excitation, "/amb/excitation", late.append, LATCHED)
        self.graph.wait_until(lambda: late, "what is latched")
        node.destroy_subscription(subscription)
        return late[-1]


@pytest.fixture
def generator(share: Callable[..., Controlled]) -> Controlled:
    made: Controlled = share(Controlled)
    made.answers = lambda _: True
    assert made.stop().success
    made.heard.clear()
    return made


def test_a_stop_is_answered_while_starts_wait_and_calls_them_off(generator: Controlled) -> None:
    generator.answers = lambda message: True if message.kind == "stop" else None
    starts = [generator.ask_to_start(), generator.ask_to_start()]  # the second one waits behind the first
    generator.graph.wait_until(lambda: generator.heard, "the first excitation")
    assert generator.stop().success
    generator.graph.wait_until(lambda: all(start.done() for start in starts), "the answers of the starts")
    for start in starts:
        assert not start.result().success
        assert start.result().message == "called off by a stop"
    kinds = [message.kind for message in generator.heard]
    assert kinds.count("square") == 1
    assert kinds[-1] == "stop"
    assert generator.latched().kind == "stop"


def test_stops_that_wait_are_answered_together(generator: Controlled) -> None:
    """A client asks again where an answer takes its time, and takes the first that comes."""
    generator.answers = lambda _: None
    stops = [generator.ask_to_stop()]
    generator.graph.wait_until(lambda: generator.heard, "the stop")
    stops.append(generator.ask_to_stop())
    generator.all_asked_has_arrived()
    assert not any(stop.done() for stop in stops)
    generator.end(generator.heard[0].id)
    generator.graph.wait_until(lambda: all(stop.done() for stop in stops), "the answers of the stops")
    assert [stop.result().message for stop in stops] == ["", ""]
    assert len({message.id for message in generator.heard}) == 1


def test_a_stop_after_a_start_is_another_one_than_the_stop_before_it(generator: Controlled) -> None:
    generator.answers = lambda _: None
    before = generator.ask_to_stop()
    generator.graph.wait_until(lambda: generator.heard, "the stop")
    start = generator.ask_to_start()
    generator.graph.wait_until(lambda: len(generator.heard) == 2, "the excitation")
    generator.answers = lambda message: message.kind == "stop"
    after = generator.ask_to_stop()
    generator.graph.wait_until(start.done, "the answer of the start")
    assert start.result().message == "called off by a stop"
    generator.end(generator.heard[0].id)
    generator.graph.wait_until(lambda: before.done() and after.done(), "the answers of the stops")
    assert before.result().success
    assert after.result().success
    assert generator.latched().id == generator.heard[-1].id
    assert generator.heard[-1].id > generator.heard[1].id, "after the start"


def test_stops_without_a_controller_all_say_so(graph: Graph) -> None:
    generator = Controlled(graph, answer_timeout=1.0)
    graph.wait_until(lambda: generator.asked().success, "a generator that knows the run")
    generator.answers = lambda _: None
    stops = [generator.ask_to_stop(), generator.ask_to_stop()]
    graph.wait_until(lambda: all(stop.done() for stop in stops), "the answers of the stops")
    for stop in stops:
        assert "is the controller running?" in stop.result().message


def test_a_refused_start_leaves_what_plays(generator: Controlled) -> None:
    first = generator.ask_to_start()
    generator.graph.wait_until(first.done, "the answer")
    assert first.result().success
    generator.answers = lambda message: message.kind == "stop"
    second = generator.ask_to_start()
    generator.graph.wait_until(second.done, "the answer")
    assert not second.result().success
    latched = generator.latched()
    assert latched.id == generator.heard[0].id, "the first one, which goes on"
    assert latched.first_step == 7, "with its step resolved"


@pytest.mark.parametrize("ended_by", ["a start that is not answered", "a stop that is not answered"])
def test_a_refused_start_does_not_bring_back_what_a_stop_has_ended(graph: Graph, ended_by: str) -> None:
    generator = Controlled(graph, answer_timeout=1.0)
    graph.wait_until(lambda: generator.asked().success, "an excitation that is accepted in time")
    generator.answers = lambda _: None
    response = generator.asked() if "start" in ended_by else generator.stop()
    assert "no answer within" in response.message
    assert generator.latched().kind == "stop"
    generator.answers = lambda message: message.kind == "stop"
    assert not generator.asked().success
    assert generator.latched().kind == "stop"


@pytest.mark.parametrize("by", ["the bridge", "a user's own node"])
def test_a_refused_start_does_not_bring_back_what_others_have_ended(generator: Controlled, by: str) -> None:
    assert generator.asked().success
    generator.end(generator.heard[0].id if by == "the bridge" else 0)
    generator.answers = lambda message: message.kind == "stop"
    assert not generator.asked().success
    assert generator.latched().kind == "stop"


def test_an_answer_to_a_generator_before_it_is_no_answer(graph: Graph) -> None:
    """Answers stay on their topic, and may reach a generator that starts anew after its own first request."""
    generator = Controlled(graph)
    assert generator.asked().success
    before = generator.heard[0].id
    generator.start_anew()

    def answer_late(message: Excitation) -> bool:
        generator.refuse(before, "of another time")
        return True

    generator.answers = answer_late
    answer = generator.asked()
    assert answer.success, answer.message
    assert generator.heard[-1].id != before


def test_a_refused_start_is_taken_back_where_nothing_played(generator: Controlled) -> None:
    generator.answers = lambda message: message.kind == "stop"
    start = generator.ask_to_start()
    generator.graph.wait_until(start.done, "the answer")
    assert not start.result().success
    assert generator.latched().kind == "stop"


def test_no_controller_takes_a_start_that_was_not_answered_in_time(graph: Graph) -> None:
    answers: list[ExcitationStatus] = []
    graph.node.create_subscription(ExcitationStatus, "/amb/excitation_status", answers.append, EVERY_STATE)
    graph.start("amb_sim_node.simulator")
    graph.start(GENERATOR, parameters={"answer_timeout": 0.1})
    start: Any = None
    while start is None or "no message" in start.message:  # of the simulator, which still starts
        start = graph.call(StartExcitation, "/amb/excitation_generator/start", **SQUARE)
    assert not start.success
    assert "no answer within" in start.message
    graph.start("amb_controller_node.pd_controller")
    graph.wait_until(lambda: answers, "the controller")
    assert [answer.kind for answer in answers] == ["stop"]
