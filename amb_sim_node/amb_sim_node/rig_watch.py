"""The bridge's memory of its rig: what the link reports is kept, counted in runs, and published.

Telemetry and trips are published from here. What concerns the life cycle is passed on to the node.
"""

from __future__ import annotations

import contextlib
import functools
import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotInTime
from dataclasses import dataclass
from typing import ParamSpec

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.ground.errors import TargetError, one_line
from amb_core.loop.machine import Machine
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.rig import BridgeTrip, Runs, RunSamples, TripLog, describe
from amb_core.rig.link import (
    ExcitationPhase,
    NoRecordError,
    TargetDescription,
    TargetLink,
    TargetState,
    TargetStatus,
    TelemetryBlock,
    Trip,
)
from amb_core.rig.trips import LOOP_STAYS, axis_of
from amb_msgs.msg import AxisSamples, LoopSamples
from amb_msgs.msg import Trip as TripMessage
from amb_ros import topics
from amb_ros.qos import EVERY_STATE, HISTORY
from amb_ros.signals import AxisSignalPublishers
from amb_sim_node.rig_host_loop import HostLoop

OFF = (TargetState.OFF, TargetState.TRIPPED)
STANDING = 1.0  # s without a control step, although the target answers
PATIENCE = 10.0  # s for which a reset waits until the target's record of a trip has been read
AGAIN, ATTEMPTS = (
    0.5,
    10,
)  # s after which what a target keeps is asked for again, since the link may be back, and how often
P = ParamSpec("P")
_PLAYS = (ExcitationPhase.ARMED, ExcitationPhase.PLAYING)


def _until_shut_down(method: Callable[P, None]) -> Callable[P, None]:
    """Let a method of the listener publish while another thread shuts the context down: then it fails, at any point."""

    @functools.wraps(method)
    def run(*args: P.args, **named: P.kwargs) -> None:
        try:
            method(*args, **named)
        except RuntimeError:
            watch = args[0]
            if watch._node.context.ok():  # type: ignore[attr-defined]
                raise

    return run


@dataclass(frozen=True)
class Reactions:
    """What the node does about news of the rig; called in the thread of the link.

    Attributes
    ----------
    changed : callable
        Publishes the state.
    stopped : callable
        The target plays its excitation no longer, or will not play it; called with its step.
    switched_off : callable
        The currents are off, by whatever.
    rebooted : callable
        The target has forgotten its settings.
    link : callable
        Returns the link, or raises TargetError; called in a thread of its own.
    """

    changed: Callable[[], None]
    stopped: Callable[[int], None]
    switched_off: Callable[[], None]
    rebooted: Callable[[], None]
    link: Callable[[], TargetLink]


class RigWatch:
    """Listener of the link.

    Parameters
    ----------
    node : Node
        The bridge.
    reactions : Reactions
        What it does about news.
    host_loop : HostLoop, optional
        Takes the samples, since the host closes the loop; then the controller node publishes the telemetry.

    Attributes
    ----------
    lock : RLock
        Held while runs and trips change: by the thread of the link, the executor and the worker.
    known : TargetDescription or None
        The target as it described itself last.
    machine : Machine or None
        That of the configuration.
    runs : Runs or None
        While the bridge is configured.
    status : TargetStatus or None
        The latest one.
    reachable : bool
        Whether the target answers.
    standing : bool
        Whether it answers, but makes no control steps: then nothing holds a rotor.
    """

    def __init__(self, node: Node, reactions: Reactions, host_loop: HostLoop | None = None) -> None:
        self._node, self._reactions, self._host_loop = node, reactions, host_loop
        self.lock = threading.RLock()
        self.known: TargetDescription | None = None
        self.machine: Machine | None = None
        self.runs: Runs | None = None
        self.status: TargetStatus | None = None
        self.reachable = self.standing = False
        self._stepped = time.monotonic()  # when its step was another one for the first time
        self._trips = TripLog()
        self._own_trips: list[Trip] = []  # latched by the bridge itself
        self._run = 0
        self._flushed = 0  # step of the target
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._telemetry_publisher = (
            node.create_publisher(LoopSamples, topics.TELEMETRY, HISTORY) if host_loop is None else None
        )
        self._signals = AxisSignalPublishers(node, 0.0)
        self._trip_publisher = node.create_publisher(TripMessage, topics.TRIP, EVERY_STATE)
        self._closed = threading.Event()
        self._reporter = ThreadPoolExecutor(1, thread_name_prefix="trips")  # in the order of their occurrence

    # -- the life cycle of the bridge

    def begin(self, description: TargetDescription, block: int, signals_rate: float) -> Runs:
        """Take a target that is configured; telemetry is published in blocks of so many steps, signals at a rate (Hz).

        If the host closes the loop, its controller node publishes both.
        """
        with self.lock:
            self.known, self.machine, self.reachable = description, description.machine, True
            self.runs = Runs(description.machine, block, self.new_run)
            self._trips, self._own_trips = TripLog(), []
            if self._host_loop is None:
                self._signals.rate = signals_rate
                self._signals.use(description.machine.axis_names)
            return self.runs

    def end(self) -> None:
        """The bridge has left the target."""
        with self.lock:
            self._publish(self.runs.end() if self.runs is not None else [])
            self.runs, self.status, self.reachable, self.standing = None, None, False, False

    def flush(self) -> None:
        """Publish a partial block if no sample has come since the last call, and trips that have waited for samples."""
        with self.lock:
            if self.runs is not None:
                if self.runs.next_target_step == self._flushed:
                    self._publish(self.runs.flush())
                self._flushed = self.runs.next_target_step
        self._publish_trips()

    def report_trips(self) -> None:
        """Publish all trips that are known, before the target forgets what it keeps of them."""
        self._publish_trips(math.inf)
        with contextlib.suppress(NotInTime):
            self._reporter.submit(lambda: None).result(PATIENCE)

    def close(self) -> None:
        """Publish nothing more."""
        self._closed.set()
        self._reporter.shutdown(wait=False, cancel_futures=True)

    def forget_own_trips(self) -> None:
        """Forget those that the bridge has latched."""
        with self.lock:
            self._own_trips.clear()

    def latched(self) -> str:
        """All latched trips as text; empty without any."""
        machine = self.machine
        if machine is None:
            return ""
        with self.lock:
            return "; ".join(describe(trip, machine) for trip in (*self._trips.latched, *self._own_trips))

    # -- the link, in its thread

    @_until_shut_down
    def on_samples(self, block: TelemetryBlock) -> None:
        """Publish what has arrived, and the trips up to there."""
        with self.lock:
            if self.runs is None or self.known is None or self.known.machine != self.machine:
                return  # not configured; or of another machine since its reboot, which activation refuses
            before = self.runs.levitated
            self._publish(self.runs.add(block))
            changed = before != self.runs.levitated
            if self._host_loop is not None:
                self._host_loop.pass_on(block, self.runs, self.machine.sample_rate)
        self._publish_trips()
        if changed:
            self._reactions.changed()

    @_until_shut_down
    def on_status(self, status: TargetStatus) -> None:
        """Note the state of the target and new trips."""
        now = time.monotonic()
        with self.lock:
            former, self.status, self.reachable = self.status, status, True
            if former is None or former.step != status.step:
                self._stepped = now
            self.standing = now - self._stepped > STANDING
            tripped = self._trips.note(status, now)
        if former is not None and former.excitation in _PLAYS and status.excitation not in _PLAYS:
            self._reactions.stopped(status.step)
        self._publish_trips()
        if former is None or tripped or (former.state, former.excitation) != (status.state, status.excitation):
            self._reactions.changed()
        if former is not None and former.state not in OFF and status.state in OFF:
            self._reactions.switched_off()

    @_until_shut_down
    def on_silence(self) -> None:
        """The target does not answer: latched, since nobody knows what the rotor does."""
        self.reachable = self.standing = False
        self._trip_by_itself(BridgeTrip.LINK_LOST)

    @_until_shut_down
    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        """The target answers again. A reboot ends the run; what the target has forgotten is sent again."""
        self.reachable, self._stepped = True, time.monotonic()
        if not rebooted:
            self._reactions.changed()
            return
        with self.lock:
            if self.runs is not None:
                self._publish(self.runs.end())
            self.known, self._trips = description, TripLog()
        self._trip_by_itself(BridgeTrip.REBOOT)
        self._reactions.rebooted()

    def new_run(self) -> int:
        """Number of a run that begins: wall-clock time (us since 1970), larger than every one before."""
        self._run = max(self._run + 1, self._wall_clock.now().nanoseconds // 1000)
        return self._run

    # -- what is published

    def _publish(self, blocks: list[RunSamples]) -> None:
        if self._node.context.ok() and self._telemetry_publisher is not None:
            for block in blocks:
                self._telemetry_publisher.publish(
                    fill_loop_samples(LoopSamples(), AxisSamples, block.run, block.record)
                )
                self._signals.publish(block.run, block.record)

    def _trip_by_itself(self, reason: BridgeTrip) -> None:
        with self.lock:
            step = self.runs.next_target_step if self.runs is not None else 0
            trip = Trip(reason, step, 0, 0.0)  # type: ignore[arg-type]
            self._own_trips.append(trip)
        self._publish_trip(trip)
        self._reactions.changed()

    def _publish_trips(self, now: float | None = None) -> None:
        """Publish the trips up to which telemetry has arrived, or that have waited for it until now (s)."""
        with self.lock:
            step = self.runs.next_target_step if self.runs is not None else 0
            ready = self._trips.ready(step, time.monotonic() if now is None else now)
        for trip in ready:
            with contextlib.suppress(RuntimeError):  # closed: the node ends
                self._reporter.submit(self._report, trip)

    def _report(self, trip: Trip) -> None:
        """Publish a trip of the target, with the record of the target where telemetry lacks something."""
        kept: list[TelemetryBlock] = []
        problem = ""
        with self.lock:
            runs = self.runs
            lacks = runs is not None and runs.holds(trip.step) and bool(runs.lacking_before(trip.step))
        try:
            if lacks:
                kept = self._kept_by_target()
            if trip.reason in LOOP_STAYS:  # the next trip has a second of its own
                self._reactions.link().forget_trip_record()
        except TargetError as error:
            problem = f"the record of the target is not there: {one_line(error)}"
        self._publish_trip(trip, kept, problem)

    def _kept_by_target(self) -> list[TelemetryBlock]:
        """What the target keeps of the second before a trip, as soon as the link is there."""
        for _ in range(ATTEMPTS - 1):
            try:
                return self._reactions.link().trip_record()
            except NoRecordError:
                raise
            except TargetError:
                if self._closed.wait(AGAIN):
                    break
        return self._reactions.link().trip_record()

    def _publish_trip(self, trip: Trip, kept: Sequence[TelemetryBlock] = (), problem: str = "") -> None:
        machine, runs = self.machine, self.runs
        if machine is None or runs is None or not self._node.context.ok():
            return
        with self.lock:
            before = runs.before(trip.step, kept)
            step, within = runs.step_of(trip.step), runs.holds(trip.step)
            lacking = runs.lacking_before(trip.step, kept) if within else ""
        if lacking and problem:
            lacking = f"{lacking}; {problem}"
        message = TripMessage(target_step=trip.step, reason=int(trip.reason), value=float(trip.value))
        message.axis = axis_of(trip, machine)
        if within:
            message.run, message.step = runs.run, step
            message.before = [fill_loop_samples(LoopSamples(), AxisSamples, runs.run, record) for record in before]
        where = f"step {step} of run {runs.run}" if message.run else f"step {trip.step} of the target, outside of runs"
        message.text = "; ".join(filter(None, (f"{describe(trip, machine)}, at {where}", lacking)))
        message.header.stamp = self._wall_clock.now().to_msg()
        self._trip_publisher.publish(message)
        self._node.get_logger().error(message.text)
