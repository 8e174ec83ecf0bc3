"""The region monitor: a live sweep, its bag played again, and telemetry of every kind."""

from __future__ import annotations

import itertools
import math
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from amb_core.excitation import Sweep
from amb_core.loop.records import LoopRecord
from amb_core.plant.machine import machine_of
from amb_core.plant.parameters import PlantParameters, RotorParameters
from amb_core.recording import Recording
from amb_core.recording.messages.loop_samples import fill_loop_samples, steps_in
from amb_core.recording.messages.region_state import region_state_from_message
from amb_core.regions import Classification, Region, RegionParameters, classify
from amb_msgs.msg import AxisSamples, LoopSamples, RegionState, SimulatorState
from amb_msgs.srv import StartRecording, StopRecording
from amb_ros.qos import EVERY_STATE, HISTORY
from tests.graph.bearing import Bearing, machine_message, machine_publisher
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph
    from tests.graph.processes import NodeProcess

MONITOR = "amb_ident_node.region_monitor"
REST = 10_000  # steps
SWEEP = Sweep(amplitude=50e-6, duration=20.0, frequency_start=10.0, frequency_end=5000.0, axes="y")
LATE = 0.5  # s
PERIOD = 500  # steps; the default of publish_period


class Listener:
    """What the monitor of a graph says."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.messages: list[RegionState] = []
        self.subscription = graph.node.create_subscription(RegionState, "/amb/region", self.messages.append, HISTORY)

    def of(self, run: int) -> list[RegionState]:
        return [message for message in self.messages if message.run == run]

    def wait_for(self, run: int, step: int) -> list[RegionState]:
        self.graph.wait_until(lambda: any(m.step >= step for m in self.of(run)), f"region at step {step} of run {run}")
        return self.of(run)

    def wait_for_region(self, run: int, region: Region) -> list[RegionState]:
        self.graph.wait_until(lambda: any(m.region == region for m in self.of(run)), f"region {region.name}")
        return self.of(run)


class Loop:
    """Publishes records as the controller would."""

    def __init__(self, graph: Graph) -> None:
        self.telemetry = graph.node.create_publisher(LoopSamples, "/amb/telemetry", HISTORY)

    def publish(self, run: int, record: LoopRecord, block: int = 100) -> None:
        for first in range(record.first_step, record.first_step + record.steps, block):
            part = record.window(first, min(block, record.first_step + record.steps - first))
            self.telemetry.publish(fill_loop_samples(LoopSamples(), AxisSamples, run, part))


def reported(states: Classification) -> list[Any]:
    """The states that the monitor must report of those that the library finds: changes, and one a period."""
    chosen, last = [], None
    for state in states.states:
        marks = (
            state.region, state.since.step, state.settled,
            *(
                (axis.region, axis.since.step, axis.sampling_beat, axis.drift is None, axis.oscillation is None)
                for axis in state.axes
            ),
        )  # fmt: skip
        if marks != last or (state.step + 1) % PERIOD == 0:
            chosen.append(state)
        last = marks
    return chosen


def same(message: RegionState, state: Any) -> bool:
    return repr(region_state_from_message(message)) == repr(state)  # equal numbers, and NaN equal to NaN


# -- a live sweep


class LiveSweep:
    """A sweep of 50 um until the rotor delevitates, monitored and recorded."""

    def __init__(self, graph: Graph, bearing: Any) -> None:
        self.graph = graph
        self.bearing = bearing
        self.listener = Listener(graph)
        graph.start("amb_bringup.graph.composed_loop")
        graph.start("amb_controller_node.excitation_generator")
        graph.start("amb_ident_node.recorder")
        graph.start(MONITOR)
        graph.wait_until(self.listener.subscription.get_publisher_count, "the monitor")
        self.run = bearing.reset()
        self.bag = graph.call(StartRecording, "/amb/recorder/start", uri="sweep").uri
        bearing.excite(SWEEP, self.run, REST)
        bearing.run(REST + 30_000)
        self.end = bearing.wait_for_mode(SimulatorState.DELEVITATED).step
        self.messages = self.listener.wait_for_region(self.run, Region.D)
        stopped = graph.call(StopRecording, "/amb/recorder/stop", wait_for_run=self.run, wait_for_step=self.end)
        assert stopped.success, stopped.message
        self.record = bearing.record(self.run, self.end)
        self.expected = reported(classify(self.record, machine=machine_of(PlantParameters()), delevitated=True))


def live_sweep(graph: Graph) -> LiveSweep:
    return LiveSweep(graph, Bearing(graph))


@pytest.fixture
def sweep(share: Any) -> LiveSweep:
    return share(live_sweep)


def test_a_live_sweep_drifts_and_then_delevitates(sweep: LiveSweep) -> None:
    regions = [message.region for message in sweep.messages]
    assert [b for a, b in zip([None, *regions], regions, strict=False) if a != b] == [Region.A, Region.B, Region.D]
    drift = next(message for message in sweep.messages if message.region == Region.B)
    assert drift.since.input_frequency == pytest.approx(147.0, rel=0.02)
    assert not drift.since.resonance
    assert [(axis.name, axis.region) for axis in drift.axes] == [("x", Region.A), ("y", Region.B)]
    assert [(bearing.name, bearing.region) for bearing in drift.bearings] == [("a", Region.B)]
    last = sweep.messages[-1]
    assert last.region == Region.D
    assert last.since.step == sweep.end, "the step whose position is in no telemetry"
    assert last.since.input_frequency == pytest.approx(328.0, rel=0.02)


def test_live_states_are_those_that_the_library_finds(sweep: LiveSweep) -> None:
    assert len(sweep.messages) == len(sweep.expected)
    assert all(map(same, sweep.messages, sweep.expected))
    steps = np.array([message.step for message in sweep.messages])
    assert np.max(np.diff(steps)) <= 1_000, "at least ten times a second"
    for message in sweep.messages:
        stamp = message.header.stamp
        assert stamp.sec + 1e-9 * stamp.nanosec == pytest.approx(1e-4 * message.step)


def test_regions_are_recorded(sweep: LiveSweep) -> None:
    recorded = list(Recording.read(sweep.bag).messages_of("/amb/region"))
    assert [(m.run, m.step, m.region) for m in recorded] == [(m.run, m.step, m.region) for m in sweep.messages]
    assert all(map(same, recorded, sweep.expected))


def test_health_names_the_region(sweep: LiveSweep) -> None:
    def named() -> bool:
        return any(
            status.name == "amb/region_monitor" and status.message == "region D, delevitated"
            for status in sweep.bearing.diagnostics
        )

    sweep.graph.wait_until(named, "the region on /diagnostics")


def start_player(graph: Graph, sweep: LiveSweep) -> NodeProcess:
    amb = "from amb_bringup.cli import main; raise SystemExit(main())"
    return graph.start_command([sys.executable, "-c", amb, "bag", "play", sweep.bag, "--rate", "20"])


def test_a_played_bag_gives_the_same_states(sweep: LiveSweep, graph: Graph) -> None:
    recorded = [message.mode for message in Recording.read(sweep.bag).messages_of("/amb/simulator/state")]
    assert recorded[-1] == SimulatorState.DELEVITATED
    listener = Listener(graph)
    graph.start(MONITOR)
    graph.wait_until(listener.subscription.get_publisher_count, "the monitor")
    player = start_player(graph, sweep)
    player.wait_for_end(TIMEOUT)
    assert player.returncode == 0, player.said
    messages = listener.wait_for_region(sweep.run, Region.D)
    assert len(messages) == len(sweep.expected)
    assert all(map(same, messages, sweep.expected))


def test_a_listener_found_late_gets_what_was_played_before(sweep: LiveSweep, graph: Graph) -> None:
    states: list[SimulatorState] = []

    def listen_late(message: LoopSamples) -> None:
        if message.first_step + steps_in(message) < sweep.end:
            return
        graph.node.destroy_subscription(telemetry)
        time.sleep(LATE)  # in the thread that spins the node, so that nothing can come before
        graph.node.create_subscription(SimulatorState, "/amb/simulator/state", states.append, EVERY_STATE)

    telemetry = graph.node.create_subscription(LoopSamples, "/amb/telemetry", listen_late, HISTORY)
    player = start_player(graph, sweep)
    graph.wait_until(lambda: states, "the state of the simulator")
    assert states[-1].mode == SimulatorState.DELEVITATED
    player.wait_for_end(TIMEOUT)
    assert player.returncode == 0, player.said


# -- telemetry of every kind


RADIUS = 250e-6  # m
KNOWN = RegionParameters(backup_bearing_radius=RADIUS)


@pytest.fixture(scope="module")
def drifting() -> LoopRecord:
    """Noise about a bias that begins to sink after 1 s."""
    steps = 15_000
    rng = np.random.default_rng(1)
    position = 1e-8 * rng.normal(size=(steps, 2))
    position[:, 1] -= 60e-6 * np.maximum(0.0, np.arange(steps) / 10_000.0 - 1.0)
    return LoopRecord(0, 1e-4, np.zeros((steps, 2)), position, np.zeros((steps, 2)))


class Monitored:
    """A monitor, and a loop that publishes what a test wants, each time as a run of its own."""

    def __init__(self, graph: Graph) -> None:
        self.loop, self.listener, self.bearing = Loop(graph), Listener(graph), Bearing(graph)
        self._runs = itertools.count(1)
        # no machine is published
        graph.start(MONITOR, parameters={"machine_timeout": 0.1, "backup_bearing_radius": RADIUS})
        graph.wait_until(self.listener.subscription.get_publisher_count, "the monitor")

    def play(self, *records: LoopRecord, block: int = 100) -> int:
        """Publish a run; returns its number."""
        run = next(self._runs)
        for record in records:
            self.loop.publish(run, record, block)
        return run

    def wait_for_health(self, region: str) -> None:
        """Wait until the last status of the monitor on /diagnostics begins with this region."""

        graph = self.bearing.graph
        graph.wait_until(lambda: self.health().message.split(";")[0] == region, f"'{region}' on /diagnostics")

    def health(self) -> DiagnosticStatus:
        """The last status of the monitor on /diagnostics, an empty one before its first."""
        own = [status for status in self.bearing.diagnostics if status.name == "amb/region_monitor"]
        return own[-1] if own else DiagnosticStatus()

    def wait_for_report(self, text: str) -> None:
        """Wait until the monitor reports this on /diagnostics."""
        self.bearing.graph.wait_until(
            lambda: any(text in status.message for status in self.bearing.diagnostics), f"'{text}' on /diagnostics"
        )


@pytest.fixture
def monitored(share: Any) -> Monitored:
    return share(Monitored)


def test_states_do_not_depend_on_the_blocks(monitored: Monitored, drifting: LoopRecord) -> None:
    runs = {monitored.play(drifting, block=block): block for block in (100, 37, 5_000)}
    expected = reported(classify(drifting, KNOWN))
    assert expected[-1].region == Region.B
    for run, block in runs.items():
        messages = monitored.listener.wait_for(run, drifting.steps - 1)
        assert len(messages) == len(expected)
        assert all(map(same, messages, expected)), f"blocks of {block}"


def test_health_says_whether_the_region_is_judged_yet(monitored: Monitored, drifting: LoopRecord) -> None:
    for steps, said in ((1_000, "region A, steady bias, too early for B and C"), (9_000, "region A, steady bias")):
        last = classify(drifting.window(0, steps), KNOWN).states[-1]
        assert (last.region, last.settled) == (Region.A, steps == 9_000)
        monitored.play(drifting.window(0, steps))
        monitored.wait_for_health(said)


def test_health_does_not_say_a_alone_where_the_loop_resonates(monitored: Monitored) -> None:
    reference = 10e-6 * np.sin(2.0 * np.pi * 40.0 * np.arange(15_000) / 10_000.0)[:, np.newaxis] * np.array([0.0, 1.0])
    record = LoopRecord(0, 1e-4, reference, 0.95 * reference, np.zeros_like(reference))
    run = monitored.play(record)
    last = monitored.listener.wait_for(run, record.steps - 1)[-1]
    assert (last.region, [axis.not_judged for axis in last.axes]) == (Region.A, ["", "B"])
    monitored.wait_for_health("no region found, B not judged")


def test_health_says_at_once_that_the_rotor_delevitated(monitored: Monitored, drifting: LoopRecord) -> None:
    """Region D is judged by the position alone: nothing has to settle."""
    start = drifting.window(0, 1_000)
    position = start.position.copy()
    position[800:, 1] = -400e-6
    fallen = LoopRecord(0, 1e-4, start.reference, position, start.current)
    last = classify(fallen, KNOWN).states[-1]
    assert (last.region, last.settled) == (Region.D, False)
    monitored.play(fallen)
    monitored.wait_for_health("region D, delevitated")


def test_health_of_a_run_ends_when_a_later_one_begins(monitored: Monitored, drifting: LoopRecord) -> None:
    graph, node = monitored.bearing.graph, monitored.bearing.graph.node
    states = node.create_publisher(SimulatorState, "/amb/simulator/state", EVERY_STATE)
    graph.wait_until(states.get_subscription_count, "the monitor")
    position = np.full((1_000, 2), 400e-6)
    run = monitored.play(LoopRecord(0, 1e-4, np.zeros_like(position), position, np.zeros_like(position)))
    monitored.wait_for_health("region D, delevitated")
    states.publish(SimulatorState(run=run + 1, mode=SimulatorState.PAUSED))
    monitored.wait_for_health(f"no region yet in run {run + 1}")
    assert monitored.health().level == DiagnosticStatus.OK
    monitored.play(drifting.window(0, 1_000))
    monitored.wait_for_health("region A, steady bias, too early for B and C")
    node.destroy_publisher(states)


def test_a_gap_is_reported_and_classification_restarts(monitored: Monitored, drifting: LoopRecord) -> None:
    parts = drifting.window(0, 5_000), drifting.window(6_000, 9_000)
    run = monitored.play(*parts)
    messages = monitored.listener.wait_for(run, drifting.steps - 1)
    expected = [state for part in parts for state in reported(classify(part, KNOWN))]
    assert len(messages) == len(expected)
    assert all(map(same, messages, expected))
    assert messages[-1].region == Region.B
    monitored.wait_for_report(f"telemetry lacks steps 5000 to 5999 of run {run}; the classification restarted")


def test_samples_that_are_not_finite_are_reported_and_left_out(monitored: Monitored, drifting: LoopRecord) -> None:
    position = drifting.position.copy()
    position[3_050, 1] = math.nan
    run = monitored.play(LoopRecord(0, 1e-4, drifting.reference, position, drifting.current))
    assert monitored.listener.wait_for(run, drifting.steps - 1)[-1].region == Region.B
    monitored.wait_for_report(f"telemetry lacks steps 3000 to 3099 of run {run}; the classification restarted")

    def refused() -> bool:
        values = [value for status in monitored.bearing.diagnostics for value in status.values]
        return any(value.key == "refused blocks" and value.value != "0" for value in values)

    monitored.bearing.graph.wait_until(refused, "the refused block on /diagnostics")
    run = monitored.play(drifting)
    assert monitored.listener.wait_for(run, drifting.steps - 1)[-1].region == Region.B
    assert all(map(same, monitored.listener.of(run), reported(classify(drifting, KNOWN)))), (
        "the next run is not touched"
    )


# -- the machine


@pytest.fixture
def touching() -> LoopRecord:
    """Four axes, of which y_b goes 220 um from the centre after 1 s."""
    steps = 12_000
    position = 1e-8 * np.random.default_rng(1).normal(size=(steps, 4))
    position[10_000:, 3] = 220e-6
    return LoopRecord(0, 1e-4, np.zeros((steps, 4)), position, np.zeros((steps, 4)))


def test_telemetry_waits_for_its_machine_and_is_judged_by_its_clearances(graph: Graph, touching: LoopRecord) -> None:
    loop, listener, bearing = Loop(graph), Listener(graph), Bearing(graph)
    machines = machine_publisher(graph.node)
    graph.start(MONITOR, parameters={"machine_timeout": 60.0})
    graph.wait_until(listener.subscription.get_publisher_count, "the monitor")
    loop.publish(1, touching)
    waits = "12000 steps of telemetry of the axes x_a, y_a, x_b, y_b wait for their machine; waiting for the machine on"
    graph.wait_until(
        lambda: any(waits in status.message for status in bearing.diagnostics), "what the monitor waits for"
    )
    assert not listener.messages
    machine = machine_of(PlantParameters(rotor=RotorParameters(model="rigid", backup_bearing_radius=200e-6)))
    machines.publish(machine_message(machine))
    messages = listener.wait_for(1, touching.steps - 1)
    expected = reported(classify(touching, machine=machine))
    assert len(messages) == len(expected)
    assert all(map(same, messages, expected))
    assert [(part.name, part.region) for part in messages[-1].bearings] == [("a", Region.A), ("b", Region.D)]
    assert messages[-1].since.step == 10_000
