"""What a recorder has received: each message is noted in the account of its topic. Thread-safe, without ROS.

The ledger outlives a recording: a gap at the beginning shows only in comparison with the messages before it.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Collection
from typing import Any

from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.time_stamp import stamped_time
from amb_ident_node.completeness import (
    KEPT_RUNS,
    AnswerAccount,
    Mark,
    PeriodicAccount,
    SequenceAccount,
    TelemetryAccount,
    forget_oldest,
)
from amb_msgs.msg import BridgeState, RegionState, SimulatorState
from amb_ros import topics

KEPT_CLOCKS = 10_000
COUNTED = {
    topics.REGION: "sequence",
    topics.SIMULATOR_STATE: "sequence",
    topics.REGION_MAP: "sequence",
    topics.MODEL: "sequence",
}
"""Topics with messages that their publisher counts, and the field with the count."""


class Ledger:
    """Accounts of the recorded topics, by their relative names.

    Attributes
    ----------
    state : SimulatorState or None
        The last one known.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._counted = {name: SequenceAccount(name) for name in COUNTED}
        self._answers = AnswerAccount()
        self._notes: dict[str, Callable[[Any], None]] = {
            topics.TELEMETRY: self._note_telemetry,
            topics.PLANT_STATE: lambda message: self._plant_states.note(message.run, message.step),
            topics.CLOCK: self._note_clock,
            topics.REGION: self._note_region,
            topics.SIMULATOR_STATE: self._note_reported_state,
            topics.EXCITATION: self._note_excitation,
            topics.EXCITATION_STATUS: lambda message: self._answers.note_answer(message.run, message.id),
            topics.BRIDGE_STATE: self._note_bridge,
        }
        self.state: Any = None
        self._bridge: Any = None  # the last state of the bridge to a rig
        self._monitor = (0, 0, 0)  # run, next step and messages of the region monitor, as it reports them
        self._learned = Mark(0, 0)  # place of a state whose message is still on its way
        self._reported = Mark(0, 0)  # place of the last state whose message has arrived
        self._ended = False
        self._last_clock = 0, 0  # run and step
        self._early_clocks: deque[int] = deque(maxlen=KEPT_CLOCKS)  # of a run without a state so far
        self.start()

    def start(self) -> None:
        """A recording starts: messages from now on belong to it."""
        with self._changed:
            self._monitor_reports = False
            self._refused: dict[str, tuple[int, str]] = {}  # by topic: how many, and why the last one was
            self._telemetry = TelemetryAccount()
            self._plant_states = PeriodicAccount(topics.PLANT_STATE)
            self._clocks = PeriodicAccount(topics.CLOCK)
            self._answers.start()
            self._regions: dict[int, int] = {}  # step up to which the regions of a run are known
            self._delevitations: dict[int, None] = {}  # runs in which a region D was received
            for account in self._counted.values():
                account.start()
            if self.state is not None:
                self._expect(self.state)

    def begin(self, origin: Mark | None) -> None:
        """The recording that has started begins at this place in a run; None if it is not known."""
        with self._changed:
            self._telemetry.begin(origin)

    def learn(self, state: Any) -> None:
        """The simulator has answered with its state. Messages of its run may arrive before that of the state."""
        with self._changed:
            if self.state is None or (state.run, state.step) > (self.state.run, self.state.step):
                self._take_state(state)
                self._learned = Mark(state.run, state.step)
                self._changed.notify_all()

    def note(self, topic: str, message: Any) -> None:
        """A message has arrived on a topic."""
        with self._changed:
            if topic in self._counted:
                self._counted[topic].note(getattr(message, COUNTED[topic]))
            if topic in self._notes:
                self._notes[topic](message)
            self._changed.notify_all()

    def note_dropped(self, topic: str, message: Any) -> None:
        """A message has arrived on a topic, and is not in the recording."""
        with self._changed:
            if topic in self._counted:
                self._counted[topic].note_dropped(getattr(message, COUNTED[topic]))
            if topic == topics.EXCITATION:
                self._answers.note_dropped(message.run, message.id)
            if topic == topics.SIMULATOR_STATE:  # its place decides what is awaited
                self._note_reported_state(message)
            self._changed.notify_all()

    def note_refused(self, topic: str, reason: str) -> None:
        """What has arrived on a topic cannot be used, and is not in the recording."""
        with self._changed:
            count, _ = self._refused.get(topic, (0, ""))
            self._refused[topic] = count + 1, reason

    def note_monitor(self, run: int, next_step: int, messages: int) -> None:
        """The region monitor reports its progress, and how many messages it has published."""
        with self._changed:
            self._monitor = run, next_step, messages
            self._monitor_reports = True
            self._changed.notify_all()

    def wake(self) -> None:
        """Let waiting threads see whether they wait in vain."""
        with self._changed:
            self._changed.notify_all()

    def end(self) -> None:
        """Release all waiting threads."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def last_run(self) -> int:
        """Run of the last telemetry in this recording; 0 before the first."""
        with self._changed:
            return next(reversed(self._telemetry.runs), 0)

    @property
    def within_run(self) -> bool:
        """Whether a run is in progress, as far as is known: not one that is paused or over, nor while a rig rests."""
        with self._changed:
            if self.state is not None:
                return self.state.mode in (SimulatorState.RUNNING, SimulatorState.WAITING)
            return self._bridge is None or self._bridge.mode not in (BridgeState.OFF, BridgeState.TRIPPED)

    @property
    def end_of_telemetry(self) -> str:
        """The last run and step with telemetry in this recording, as text."""
        with self._changed:
            run = next(reversed(self._telemetry.runs), 0)
            return (
                f"telemetry ends at step {self._telemetry.stop(run) - 1} of run {run}" if run else "no telemetry came"
            )

    @property
    def has_monitor(self) -> bool:
        """Whether a region, or a report of the region monitor, was received in this recording."""
        with self._changed:
            return bool(self._regions) or self._monitor_reports

    def wait_for(
        self, awaited: Mark, published: Collection[str], timeout: float, in_vain: Callable[[], bool] = lambda: False
    ) -> None:
        """Wait until everything up to a place in a run has arrived on the published topics.

        Returns earlier after the timeout (s), after a call of `end`, or when `in_vain` returns true, which is asked
        after each message and each call of `wake`.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._ended or in_vain() or not self._late(awaited, published), max(timeout, 0.0)
            )

    def lacks(self, awaited: Mark | None = None, published: Collection[str] = ()) -> list[str]:
        """What is missing, one text per topic and run; optionally up to a place in a run."""
        with self._changed:
            texts = self._telemetry.lacks(awaited)
            runs = {run: self._telemetry.stop(run) for run in self._telemetry.runs}
            if awaited is not None:
                # A run that continues has telemetry after the awaited step. Its other messages may not be here yet.
                runs[awaited.run] = awaited.step
            for run, stop in runs.items():
                first = self._telemetry.first_due(run)
                closed = stop + 1 if self._simulator_reached(Mark(run, stop)) else stop
                texts += self._plant_states.lacks(run, first, closed)
                texts += self._clocks.lacks(run, max(first, 1), stop)  # step 0: before the run is known
            for account in self._counted.values():
                texts += account.lacks()
            if awaited is not None:
                texts += self._answers.lacks(topics.EXCITATION in published)
                if topics.REGION in published and not self._regions_reached(awaited):
                    texts.append(self._missing_region(awaited))
                if self._state_awaited(published) and not self._simulator_reached(awaited):
                    texts.append(f"simulator/state lacks that of step {awaited.step} of run {awaited.run}")
            for topic, (count, reason) in self._refused.items():
                messages = "a message on" if count == 1 else f"{count} messages on"
                texts.append(f"{messages} {topic} {'was' if count == 1 else 'were'} refused: {reason}")
            return texts

    @property
    def conflict(self) -> str:
        """Steps that arrived twice with different samples, as text; empty if there are none."""
        with self._changed:
            return self._telemetry.conflict

    # -- content of the messages; called with the lock held

    def _note_telemetry(self, message: Any) -> None:
        self._telemetry.note(message.run, block_from_message(message))

    def _note_excitation(self, message: Any) -> None:
        self._answers.note_excitation(message.run, message.id)

    def _note_reported_state(self, message: Any) -> None:
        self._reported = Mark(message.run, message.step)
        if (message.run, message.step) < (self._learned.run, self._learned.step):
            self._expect(message)
            return
        self._learned = Mark(0, 0)
        self._take_state(message)

    def _note_bridge(self, message: Any) -> None:
        self._bridge = message

    def _take_state(self, message: Any) -> None:
        new_run = self.state is None or message.run != self.state.run
        self.state = message
        self._expect(message)
        if new_run:
            for step in self._early_clocks:
                self._clocks.note(message.run, step)
                self._last_clock = message.run, step
            self._early_clocks.clear()

    def _expect(self, state: Any) -> None:
        self._plant_states.expect(state.run, state.plant_state_steps)
        self._clocks.expect(state.run, state.clock_steps)

    def _note_clock(self, message: Any) -> None:
        """Note a clock. It does not carry its run: if the time goes back, it belongs to a run not known yet."""
        if self.state is None or not self.state.sample_time > 0.0:
            return
        steps = stamped_time(message.clock) / self.state.sample_time
        if not math.isfinite(steps):
            return
        run, step = self.state.run, round(steps)
        last_run, last_step = self._last_clock
        if self._early_clocks or (run == last_run and step < last_step):
            self._early_clocks.append(step)
            return
        self._last_clock = run, step
        self._clocks.note(run, step)

    def _note_region(self, message: Any) -> None:
        self._regions[message.run] = max(self._regions.get(message.run, 0), message.next_step)
        forget_oldest(self._regions, KEPT_RUNS)
        if message.region == RegionState.D:
            self._delevitations[message.run] = None
            forget_oldest(self._delevitations, KEPT_RUNS)

    # -- progress; called with the lock held

    def _late(self, awaited: Mark, published: Collection[str]) -> bool:
        last_clock = Mark(awaited.run, max(awaited.step - 1, 0))
        return not (
            self._telemetry.reached(awaited)
            and (not self._state_awaited(published) or self._simulator_reached(awaited))
            and (topics.PLANT_STATE not in published or self._plant_states.reached(awaited))
            and (topics.CLOCK not in published or self._clocks.reached(last_clock))
            and (topics.REGION not in published or self._regions_reached(awaited))
            and self._answers.reached(topics.EXCITATION in published)
        )

    def _simulator_reached(self, place: Mark) -> bool:
        return (self._reported.run, self._reported.step) >= (place.run, place.step)

    def _state_awaited(self, published: Collection[str]) -> bool:
        """Whether a simulator reports its state; a test rig on the same topics need not."""
        return self.state is not None and topics.SIMULATOR_STATE in published

    def _regions_reached(self, awaited: Mark) -> bool:
        if self._delevitated_at(awaited):  # a region of the telemetry may reach as far before that of the delevitation
            return awaited.run in self._delevitations
        if self._regions.get(awaited.run, 0) >= awaited.step:
            return True
        run, next_step, messages = self._monitor  # in a run too short for a region it has nothing to publish
        return run == awaited.run and next_step >= awaited.step and messages <= self._counted[topics.REGION].last

    def _delevitated_at(self, place: Mark) -> bool:
        state = self.state
        return (
            state is not None
            and state.mode == SimulatorState.DELEVITATED
            and (state.run, state.step) == (place.run, place.step)
        )

    def _missing_region(self, awaited: Mark) -> str:
        known = self._regions.get(awaited.run, self._telemetry.first_step(awaited.run))
        if known >= awaited.step:
            return f"region of run {awaited.run} lacks the delevitation before step {awaited.step}"
        return f"region of run {awaited.run} lacks steps {known} to {awaited.step - 1} ({awaited.step - known} steps)"
