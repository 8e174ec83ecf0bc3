"""The bridge's side of an excitation: a message becomes samples, is checked, goes to the target, and is armed there.

The answer on `excitation_status` follows when the target has armed it, with the exact step, or with the reason why not.
One that ends before its last step, by the bridge or by the target, gets a second answer: the end of what plays.
"""

from __future__ import annotations

import contextlib
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node

from amb_core.excitation import ExcitationSignal, Playback
from amb_core.excitation.playback import instantaneous_frequency
from amb_core.ground.errors import AmbError, ExcitationError, TargetError, one_line
from amb_core.ground.plain_text import plain_text
from amb_core.loop.machine import Machine
from amb_core.rig import ExcitationProtection, Runs
from amb_core.rig.link import ExcitationPhase, TargetLink, TargetState, TargetStatus, TooLateError
from amb_msgs.msg import Excitation, ExcitationStatus
from amb_ros import topics
from amb_ros.excitation_answers import ExcitationAnswers, Identity, answer_to, identity_of
from amb_ros.excitation_messages import STOP, Checked, check, read, require_samples, resolve
from amb_ros.qos import EVERY_STATE
from amb_ros.subscriptions import create_subscription
from amb_sim_node.region_guard import Guard

LEAD = 0.02  # s from the next step of the target until an excitation begins that is to begin as soon as possible
ATTEMPTS = 5  # to arm one; a frame that is lost costs more than the lead
FADE_TIMEOUT = 70.0  # s; the longest fade of a target, and some


@dataclass(frozen=True)
class Rig:
    """What is behind the bridge while it is configured."""

    link: TargetLink
    machine: Machine
    runs: Runs
    protection: ExcitationProtection
    guard: Guard


@dataclass(frozen=True)
class _Applied:
    """The latest excitation that the target has taken, or stop.

    Attributes
    ----------
    identity : tuple
        What a copy of it has, with its step resolved.
    runs : Runs
        Those in which it was taken.
    run, id : int
        Its run and number.
    stop : int
        Step of the target after its last one.
    """

    identity: Identity
    runs: Runs
    run: int
    id: int
    stop: int


class RigExcitation:
    """Topics `excitation` and `excitation_status` of the bridge.

    Parameters
    ----------
    node : Node
        The bridge.
    rig_of : callable
        Returns the rig; None while the bridge is not active.
    """

    def __init__(self, node: Node, rig_of: Callable[[], Rig | None]) -> None:
        self._node, self._rig_of = node, rig_of
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="rig_excitation")
        self._newest = 0  # number of the newest message: older ones are called off
        self._lock = threading.Lock()  # of newest and applied; held while answers are published, for their order
        self._answers = ExcitationAnswers(node)
        self._applied: _Applied | None = None
        self._subscription = create_subscription(
            node, Excitation, topics.EXCITATION, self._on_excitation, EVERY_STATE, raw=True
        )

    def call_off(self) -> None:
        """Give up what is on its way to the target."""
        with self._lock:
            self._newest += 1

    def end(self, step: int) -> None:
        """Report that nothing plays any more, from a step of the target onwards, if that is before the last sample."""
        with self._lock:
            applied = self._applied
            if applied is None or step >= applied.stop:
                return
            self._applied = None
            if applied.run == applied.runs.run:
                self._answers.end(applied.run, applied.id, applied.runs.next_step)

    def close(self) -> None:
        """Give up, and end the worker."""
        self.call_off()
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _on_excitation(self, data: bytes) -> None:
        message = read(data)
        if isinstance(message, ExcitationStatus):
            self._answers.refuse(message, message.message)
            return
        with self._lock:
            if self._applied is not None and identity_of(message, message.first_step) == self._applied.identity:
                return  # published again with its step resolved
            self._newest += 1
            number = self._newest
        self._worker.submit(self._apply, message, number)

    # -- in the worker

    def _apply(self, message: Excitation, number: int) -> None:
        """Apply an excitation, and answer it in every case."""
        status = answer_to(message)

        def called_off() -> bool:
            return number != self._newest

        try:
            rig = self._rig_of()
            if rig is None or not rig.runs.levitated:
                raise ExcitationError("the rotor is not levitated; activate hardware_bridge first")
            resolve(message, rig.runs.run, rig.runs.next_step - 1)
            status.run = message.run
            if message.run != rig.runs.run:
                raise ExcitationError(f"meant for run {message.run}; the present run is {rig.runs.run}")
            checked = check(message, rig.machine, rig.runs.run, rig.runs.next_step - 1)
            first_step = self._play(rig, message, checked, called_off)
        except AmbError as problem:
            self._answers.refuse(status, "replaced by a later one" if called_off() else one_line(problem))
            return
        except Exception as problem:  # in every case the sender gets an answer and the bridge goes on
            self._node.get_logger().error(plain_text(traceback.format_exc()))
            self._answers.refuse(status, f"internal error: {problem!r}; see the log of the bridge")
            return
        self._node.get_logger().info(f"excitation {status.kind} from step {first_step}")
        stop = rig.runs.target_step_of(first_step + checked.steps) if checked.steps else 0
        with self._lock:
            self._applied = _Applied(identity_of(message, first_step), rig.runs, message.run, message.id, stop)
            self._answers.accept(status, first_step, checked.steps)
        with contextlib.suppress(TargetError):
            now = rig.link.status()
            if checked.steps and now.excitation not in (ExcitationPhase.ARMED, ExcitationPhase.PLAYING):
                self.end(now.step)  # it has ended before its answer, by a trip for example

    def _play(self, rig: Rig, message: Excitation, checked: Checked, called_off: Callable[[], bool]) -> int:
        """Bring it to the target and arm it. The step of the run at which it begins."""
        if message.kind == STOP:
            rig.link.disarm()
            self.end(rig.runs.next_target_step)
            return rig.runs.next_step
        rig.protection.require_length(checked.steps)
        samples = self._samples(rig, checked, called_off)
        rig.protection.require(samples, rig.runs.position)
        status = rig.link.status()
        first = None if message.first_step == Excitation.FROM_NEXT_STEP else int(message.first_step)
        if first is not None:
            earliest = status.step + (rig.protection.fade_steps if status.excitation is ExcitationPhase.PLAYING else 0)
            _require_in_time(rig, first, earliest)
        try:
            self._make_room(rig, status, called_off)
            return self._arm(rig, samples, first, called_off)
        except Exception as problem:
            if failure := self._take_back(rig, status.step):
                raise ExcitationError(f"{problem}; {failure}") from problem
            raise

    def _take_back(self, rig: Rig, step: int) -> str:
        """Disarm after a failure, since a lost reply does not show what the target does; why that fails, too."""
        try:
            rig.link.disarm()
        except TargetError as problem:
            return f"the target may play it nevertheless, and could not be stopped: {problem}"
        self.end(step)
        return ""

    def _arm(self, rig: Rig, samples: NDArray[np.float64], first: int | None, called_off: Callable[[], bool]) -> int:
        """Upload an excitation and arm it, for a step of the run or as soon as possible. The step of the run."""
        arm = rig.link.upload(samples, called_off)
        if first is None:
            return rig.runs.step_of(self._arm_soon(rig, arm))
        try:
            arm(rig.runs.target_step_of(first))
        except TooLateError as problem:
            _require_in_time(rig, first, problem.next_step)
            raise
        return first

    def _samples(self, rig: Rig, checked: Checked, called_off: Callable[[], bool]) -> NDArray[np.float64]:
        """All samples of an excitation, shape (steps, axes), from its message or its definition."""
        if checked.excitation is None:
            rig.guard(None)
            return checked.samples
        machine, rate = rig.machine, rig.machine.sample_rate
        playback = Playback(checked.excitation, rate, machine, called_off)
        require_samples(checked.checksum, playback.checksum)
        samples = np.empty((playback.steps, len(machine.axes)))
        index = 0
        while index < playback.steps:
            first, window = playback.window(index)
            samples[first : first + len(window)] = window
            index = first + len(window)
        frequency = instantaneous_frequency(checked.excitation, rate, machine)
        kind = checked.excitation.kind
        rig.guard(ExcitationSignal(kind, checked.excitation, 1.0 / rate, samples, frequency, machine))
        return samples

    def _make_room(self, rig: Rig, status: TargetStatus, called_off: Callable[[], bool]) -> None:
        """Stop the excitation that plays, since a new one replaces it, and wait until it has faded."""
        if status.excitation is ExcitationPhase.NONE:
            return
        rig.link.disarm()
        self.end(status.step)
        until = time.monotonic() + FADE_TIMEOUT
        while rig.link.status().excitation is not ExcitationPhase.NONE:
            if called_off():
                raise ExcitationError("called off")
            if time.monotonic() > until:
                raise ExcitationError("the excitation before it does not end")
            time.sleep(0.002)

    def _arm_soon(self, rig: Rig, arm: Callable[[int], None]) -> int:
        lead = LEAD
        for _ in range(ATTEMPTS):
            status = rig.link.status()
            if status.state is not TargetState.LEVITATED:
                raise ExcitationError(f"the target is {status.state.name.lower()}; it excites a levitated rotor only")
            step = status.step + round(lead * rig.machine.sample_rate)
            try:
                arm(step)
            except TooLateError:
                lead *= 4.0
                continue
            return step
        raise ExcitationError("the target did not take it in time; is the network overloaded?")


def _require_in_time(rig: Rig, first: int, target_step: int) -> None:
    """Raise ExcitationError if a step of the run comes before the earliest step of the target that is possible."""
    allowed = rig.runs.step_of(target_step)
    if first < allowed:
        raise ExcitationError(
            f"step {first} comes before the excitation can be on the target; allowed for first_step: {allowed} or later"
        )
