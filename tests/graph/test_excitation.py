"""Excitations over topics: definitions and waveforms, hostile messages, late samples, controllers that join a run."""

from __future__ import annotations

import json
import signal
import time
from array import array
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import serialize_message

from amb_core.excitation import Multisine, Playback, Square, Sweep, definition_of, excitation_from_request, generate
from amb_core.excitation.playback import checksum_of
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.machine import machine_of
from amb_core.plant.simulation import simulate
from amb_msgs.msg import AxisReference, CurrentReference, Excitation, ExcitationStatus, RotorPosition
from amb_msgs.srv import StartExcitation
from amb_ros.diagnostics import WARN
from amb_ros.qos import EVERY_STATE, LATCHED, STREAM
from tests.graph.bearing import Bearing, machine_message, machine_publisher
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from collections.abc import Callable

    from amb_core.excitation import Excitation as ExcitationParameters
    from tests.graph.conftest import Graph

SIMULATOR = "amb_sim_node.simulator"
CONTROLLER = "amb_controller_node.pd_controller"
GENERATOR = "amb_controller_node.excitation_generator"
RATE = 10_000.0
STEPS, EXCITED_FROM = 1_500, 200
NEVER = 2**60  # a run that no test reaches

VOLATILE = copy(LATCHED)
VOLATILE.durability = DurabilityPolicy.VOLATILE


class User:
    """A user's own node: publishes excitations without history, and hears the answers."""

    def __init__(self, graph: Graph, name: str = "user") -> None:
        self.graph = graph
        self.answers: list[ExcitationStatus] = []
        self._id = 1_000
        node = graph.add_node(name)
        self._publisher = node.create_publisher(Excitation, "/amb/excitation", VOLATILE)
        node.create_subscription(ExcitationStatus, "/amb/excitation_status", self.answers.append, EVERY_STATE)

    def send(self, message: Excitation | bytes) -> None:
        self.graph.wait_until(self._publisher.get_subscription_count, "a controller")
        self._publisher.publish(message)

    def ask(self, message: Excitation) -> ExcitationStatus:
        self._id += 1
        message.id = self._id
        self.send(message)
        return self.answer(self._id)

    def answer(self, number: int) -> ExcitationStatus:
        def mine() -> list[ExcitationStatus]:
            return [answer for answer in self.answers if answer.id == number]

        self.graph.wait_until(mine, f"an answer to excitation {number}")
        return mine()[-1]


class Loop:
    """A controller alone, and a test that plays the simulator."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.answered: list[CurrentReference] = []
        self._node = graph.add_node("loop")
        self._publisher = self._node.create_publisher(RotorPosition, "/amb/position", STREAM)
        self._node.create_subscription(CurrentReference, "/amb/current_reference", self.answered.append, STREAM)
        self._machines = machine_publisher(self._node)
        self._machines.publish(machine_message(machine_of(PlantParameters())))

    def wait_for_controller(self) -> None:
        self.graph.wait_until(
            lambda: self._publisher.get_subscription_count() and self._node.count_publishers("/amb/current_reference"),
            "the controller",
        )

    def send(self, run: int, step: int) -> None:
        self._publisher.publish(RotorPosition(run=run, step=step, time=step / RATE, position=[0.0, 0.0]))

    def is_answered(self, run: int, step: int) -> bool:
        return any((answer.run, answer.step) == (run, step) for answer in self.answered)

    def reach(self, run: int, step: int) -> None:
        """As the simulator: asks again until it has an answer."""
        deadline = time.monotonic() + TIMEOUT
        while not self.is_answered(run, step):
            assert time.monotonic() < deadline, f"step {step} was not answered"
            self.send(run, step)
            time.sleep(0.05)


def definition(excitation: ExcitationParameters, run: int, first_step: int = -1, **changes: Any) -> Excitation:
    played = Playback(excitation, RATE)
    fields = {
        "run": run, "kind": excitation.kind, "description": definition_of(excitation), "first_step": first_step,
        "sample_time": 1.0 / RATE, "steps": played.steps, "checksum": played.checksum,
    }  # fmt: skip
    return Excitation(**fields | changes)


def reference(axis: str, samples: int) -> AxisReference:
    return AxisReference(name=axis, reference=array("d", np.zeros(samples).tobytes()))


def waveform(samples: np.ndarray, run: int, first_step: int = -1, **changes: Any) -> Excitation:
    fields = {
        "run": run, "kind": "waveform", "first_step": first_step, "sample_time": 1.0 / RATE,
        "axes": [
            AxisReference(name=axis, reference=array("d", samples[:, column].tobytes()))
            for column, axis in enumerate("xy")
        ],
    }  # fmt: skip
    return Excitation(**fields | changes)


def without_ros(samples: np.ndarray, steps: int = STEPS, first_step: int = EXCITED_FROM) -> Any:
    return simulate(Plant(), PdController(ControllerParameters()), steps, samples, first_step)


def loop_with_generator(graph: Graph) -> Bearing:
    for module in (SIMULATOR, CONTROLLER, GENERATOR):
        graph.start(module)
    loop = Bearing(graph)
    loop.user = User(graph)
    return loop


@pytest.fixture
def running(share: Callable[..., Bearing]) -> Bearing:
    """A loop with generator."""
    return share(loop_with_generator, Bearing.resets)


@pytest.fixture
def user(running: Bearing) -> User:
    return running.user


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("sweep", {"spacing": "logarithmic"}),
        ("multisine", {"phasing": "optimised", "interleaved": True, "frequency_end": 1_000.0}),
        ("prbs", {}),
        ("white_noise", {"axes": "in_turn"}),
    ],
)
def test_the_controller_plays_the_samples_of_the_loop_without_ros(running, kind, values) -> None:
    excitation = excitation_from_request(kind, {"amplitude": 5e-6, "duration": 0.1, **values})
    run = running.reset()
    running.excite(excitation, run, EXCITED_FROM)
    running.run(STEPS)
    assert running.record(run, STEPS).identical_to(without_ros(generate(excitation, RATE).samples))


def test_samples_of_a_user_are_played_from_a_publisher_without_history(running, user) -> None:
    samples = 1e-5 * np.random.default_rng(0).uniform(-1.0, 1.0, (500, 2))
    run = running.reset()
    answer = user.ask(waveform(samples, run, EXCITED_FROM, checksum=checksum_of(samples)))
    assert answer.accepted, answer.message
    assert (answer.first_step, answer.steps) == (EXCITED_FROM, 500)
    running.run(STEPS)
    assert running.record(run, STEPS).identical_to(without_ros(samples))


def test_600_s_travel_in_less_than_a_kilobyte(running, user) -> None:
    heard: list[bytes] = []
    running.graph.node.create_subscription(Excitation, "/amb/excitation", heard.append, LATCHED, raw=True)
    run = running.reset()
    answer = running.graph.call(
        StartExcitation, "/amb/excitation_generator/start", kind="sweep", amplitude=1e-6, duration=600.0, run=run,
        first_step=5,
    )  # fmt: skip
    assert answer.success, answer.message
    assert answer.steps == 6_000_000
    running.graph.wait_until(lambda: any(b'"duration": 600.0' in data for data in heard), "the excitation")
    assert max(map(len, heard)) < 1_000


SQUARE = Square(amplitude=1e-5, duration=0.1)
FLAT = np.full((10, 2), 1e-6)


def hostile() -> dict[str, tuple[Any, str]]:
    def bad(index: int, value: float) -> np.ndarray:
        samples = FLAT.copy()
        samples[index, 1] = value
        return samples

    allowed = "m is not allowed; allowed: -0.001 to 0.001 m"
    return {
        "NaN": (waveform(bad(3, np.nan), NEVER), f"reference[3] of axis y = nan {allowed}"),
        "infinity": (waveform(bad(9, -np.inf), NEVER), f"reference[9] of axis y = -inf {allowed}"),
        "huge": (waveform(bad(0, 1e300), NEVER), f"reference[0] of axis y = 1e+300 {allowed}"),
        "lengths": (waveform(FLAT, NEVER, axes=[reference("x", 10), reference("y", 1)]), "10 samples on x but 1 on y"),
        "unknown axis": (waveform(FLAT, NEVER, axes=[reference("z", 10)]), "axis 'z' is not an axis of this machine"),
        "axis twice": (waveform(FLAT, NEVER, axes=[reference("x", 10)] * 2), "axis 'x' is given twice; allowed: x, y"),
        "empty": (waveform(FLAT[:0], NEVER), "a waveform without samples"),
        "too many": (waveform(np.zeros((200_001, 2)), NEVER), "samples of 200001 steps; allowed: 200000"),
        "much too many": (waveform(np.zeros((2_000_000, 2)), NEVER), "bytes; allowed: "),
        "wrong steps": (waveform(FLAT, NEVER, steps=11), "steps = 11, but it has samples of 10"),
        "wrong checksum": (waveform(FLAT, NEVER, checksum=7_000), "not 7000 as it states"),
        "end of time": (definition(SQUARE, NEVER, 2**63 - 1), f"exceeds the last allowed step {2**63 - 1}"),
        "endless": (definition(SQUARE, NEVER, 5, steps=2**64 - 1), f"exceeds the last allowed step {2**63 - 1}"),
        "misfit": (definition(SQUARE, NEVER, steps=999), "steps = 999, but its description makes 1000"),
        "stop with samples": (Excitation(run=NEVER, kind="stop", first_step=-1, steps=5), "a stop has no samples"),
        "no text": (definition(SQUARE, NEVER, kind="squ\u20ac\x00re"), "unknown kind of excitation"),
        "no Unicode": (definition(SQUARE, NEVER, description='{"\\ud800": 1}'), r"unknown parameter '\ud800' = 1"),
        "no JSON": (definition(SQUARE, NEVER, description="{"), "square: its description is not a JSON object"),
        "deep JSON": (definition(SQUARE, NEVER, description="[" * 200_000), "nested too deeply"),
        "long kind": (definition(SQUARE, NEVER, kind="a\n" * 10_000), "unknown kind of excitation"),
        "no kind": (Excitation(run=NEVER, first_step=-1, sample_time=1.0 / RATE), "unknown kind of excitation ''"),
        "past run": (definition(SQUARE, 1), "meant for run 1; the present run is"),
        "before -1": (definition(SQUARE, NEVER, -2), "first_step = -2; allowed:"),
        "no sample time": (definition(SQUARE, NEVER, sample_time=0.0), "made for a sample time of 0 s; the controller"),
        "NaN sample time": (definition(SQUARE, NEVER, sample_time=np.nan), "made for a sample time of nan s"),
        "other samples": (definition(SQUARE, NEVER, checksum=7), "those of the sender 7; does it run another version"),
        "amplitude": (
            definition(SQUARE, NEVER, description=json.dumps({"amplitude": 1.0, "duration": 0.1})),
            "'amplitude' = 1.0 is not allowed; allowed: 1e-09 to 0.001 m",
        ),
        "duration": (
            definition(SQUARE, NEVER, description=json.dumps({"amplitude": 1e-5, "duration": 1e9})),
            "'duration' = 1000000000.0 is not allowed; allowed: 0.001 to 600 s",
        ),
    }


@pytest.mark.parametrize("case", list(hostile()))
def test_a_hostile_message_is_refused_in_one_line(running, user, case) -> None:
    if case == "past run":
        running.reset()
        running.run(1)
        running.wait_for_step(running.states[-1].run, 1)
    message, reason = hostile()[case]
    answer = user.ask(message)
    assert not answer.accepted
    assert reason in answer.message
    assert "\n" not in answer.message
    assert len(answer.message) <= 400
    assert len(answer.kind) <= 50
    assert running.graph.process_of(CONTROLLER).poll() is None


def test_a_message_that_cannot_be_read_is_refused(running, user) -> None:
    message = definition(SQUARE, NEVER, id=77_777)
    user.send(serialize_message(message)[:40])  # up to its id
    answer = user.answer(77_777)
    assert not answer.accepted
    assert "the message cannot be read" in answer.message
    assert running.graph.process_of(CONTROLLER).poll() is None


def test_a_stop_that_gives_nothing_but_its_kind_ends_the_excitation_of_the_present_run(running, user) -> None:
    run = running.reset()
    running.run(10)
    running.wait_for_step(run, 10)
    assert user.ask(definition(Square(amplitude=1e-5, duration=0.1), 0, 20)).accepted
    user.answers.clear()
    user.send(Excitation(kind="stop"))  # as `ros2 topic pub /amb/excitation amb_msgs/msg/Excitation "{kind: stop}"`
    answer = user.answer(0)
    assert answer.accepted, answer.message
    assert (answer.run, answer.first_step, answer.steps) == (run, 10, 0)
    running.run(200)
    assert not running.record(run, 200).reference.any()


def test_an_answer_that_no_controller_gives_is_not_taken_for_one(graph) -> None:
    """The test is the controller, and a stranger who answers first."""
    node = graph.node
    machine = machine_publisher(node)
    machine.publish(machine_message(machine_of(PlantParameters())))
    answers = node.create_publisher(ExcitationStatus, "/amb/excitation_status", EVERY_STATE)

    def answer(message: Excitation) -> None:
        for first_step in (2**64 - 1, 2**63, 40):
            answers.publish(ExcitationStatus(run=message.run, id=message.id, accepted=True, first_step=first_step))

    node.create_subscription(Excitation, "/amb/excitation", answer, LATCHED)
    graph.start(GENERATOR)
    graph.wait_until(answers.get_subscription_count, "the generator")
    answer = graph.call(
        StartExcitation, "/amb/excitation_generator/start", kind="square", amplitude=1e-6, duration=0.1, run=7
    )
    assert answer.success, answer.message
    assert answer.first_step == 40


# -- the controller alone


@pytest.fixture
def loop(graph) -> Loop:
    return Loop(graph)


LONG = Multisine(amplitude=1e-6, duration=600.0, frequency_end=2_000.0, phasing="optimised")  # takes seconds to make


def test_the_loop_goes_on_while_samples_are_made_and_a_step_that_has_passed_is_refused(graph, loop) -> None:
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    user = User(graph)
    loop.reach(5, 0)
    long = Excitation(
        run=5, id=1, kind="multisine", description=definition_of(LONG), first_step=3, sample_time=1.0 / RATE,
        steps=6_000_000,
    )  # fmt: skip
    user.send(long)
    replaced = copy(long)
    replaced.id = 2
    user.send(replaced)
    assert "replaced by excitation 2 before its samples were ready" in user.answer(1).message
    for step in range(1, 6):
        loop.reach(5, step)
    assert not any(answer.id == 2 for answer in user.answers), "the samples were made too fast for this test"
    user.send(Excitation(run=5, id=3, kind="stop", first_step=-1))
    assert "replaced by excitation 3" in user.answer(2).message
    assert user.answer(3).accepted


def test_an_explicit_step_that_passes_while_samples_are_made_is_refused(graph, loop) -> None:
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    user = User(graph)
    loop.reach(5, 0)
    sweep = Sweep(amplitude=1e-6, duration=600.0)
    user.send(definition(sweep, 5, 3, id=1))
    for step in range(1, 6):
        loop.reach(5, step)
    answer = user.answer(1)
    assert not answer.accepted
    assert "before its samples were ready" in answer.message


def test_a_controller_that_joins_an_excited_run_waits_for_the_samples(graph, loop) -> None:
    generator = graph.add_node("generator")
    publisher = generator.create_publisher(Excitation, "/amb/excitation", LATCHED)
    sweep = Sweep(amplitude=1e-4, duration=600.0, axes="x")
    publisher.publish(definition(sweep, 5, 100, id=1))
    answers: list[ExcitationStatus] = []
    generator.create_subscription(ExcitationStatus, "/amb/excitation_status", answers.append, EVERY_STATE)
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    loop.reach(5, 600_000)
    assert [(answer.accepted, answer.first_step, answer.steps) for answer in answers] == [(True, 100, 6_000_000)]
    first, samples = Playback(sweep, RATE).window(599_900)
    law = PdController(ControllerParameters())
    expected = law.update((0.0, 0.0), (float(samples[599_900 - first, 0]), 0.0))
    assert (loop.answered[0].step, *loop.answered[0].current) == (600_000, *expected)
    assert expected[0] != 0.0


def test_an_excitation_that_arrives_too_late_names_the_steps_that_were_run_without_it(graph, loop) -> None:
    first = graph.start(CONTROLLER)
    generator = graph.start(GENERATOR)
    loop.wait_for_controller()
    loop.reach(5, 0)
    started = graph.call(
        StartExcitation, "/amb/excitation_generator/start", kind="square", amplitude=1e-5, duration=1.0, run=5,
        first_step=100,
    )  # fmt: skip
    assert started.success, started.message
    graph.stop(first)
    generator.send_signal(signal.SIGSTOP)  # what it has published reaches nobody until it goes on
    try:
        graph.start(CONTROLLER)
        loop.wait_for_controller()
        user, bearing = User(graph), Bearing(graph)
        for step in (1_000, 1_001):
            loop.reach(5, step)
    finally:
        generator.send_signal(signal.SIGCONT)
    graph.wait_until(lambda: user.answers, "the answer")
    answer = user.answers[-1]
    assert (answer.accepted, answer.first_step, answer.steps) == (True, 100, 10_000)
    assert answer.message == "arrived late: steps 1000 to 1001 were run without it"
    report = f"excitation {answer.id} of run 5 {answer.message}"
    graph.wait_until(lambda: (WARN, report) in words_of(bearing, "amb/pd_controller"), "the warning")


def test_a_controller_that_joins_a_run_waits_longer_where_somebody_publishes_excitations(graph, loop) -> None:
    graph.node.create_publisher(Excitation, "/amb/excitation", LATCHED)
    bearing = Bearing(graph)
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    loop.reach(5, 1_000)
    report = "step 1000 of run 5 waits for the excitation that may be under way: /amb/excitation has a publisher"
    graph.wait_until(lambda: (WARN, report) in words_of(bearing, "amb/pd_controller"), "the warning")


def words_of(bearing: Bearing, name: str) -> list[tuple[bytes, str]]:
    """Levels and texts of a node on /diagnostics."""
    return [(status.level, status.message) for status in bearing.diagnostics if status.name == name]


def test_a_controller_that_joins_a_run_without_excitation_answers(graph, loop) -> None:
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    loop.reach(5, 1_000)


def test_an_excitation_that_is_published_again_is_answered_once(graph, loop) -> None:
    graph.start(CONTROLLER)
    loop.wait_for_controller()
    user = User(graph)
    loop.reach(5, 0)
    for _ in range(3):
        user.send(definition(SQUARE, 5, 50, id=1))
        assert user.answer(1).accepted
    loop.reach(5, 1)
    user.send(Excitation(run=5, id=2, kind="stop", first_step=-1))
    assert user.answer(2).accepted
    assert [answer.id for answer in user.answers] == [1, 2]
