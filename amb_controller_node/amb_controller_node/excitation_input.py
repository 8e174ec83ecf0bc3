"""The controller's side of an excitation: checks messages, makes samples from definitions, plays them step by step.

A worker makes the samples of a definition, so the loop continues meanwhile. The answer follows when they are ready.
There is one exception: a controller may join a run in which an excitation is already active. It then delays its answers
to positions until it has the samples, so that the samples of the loop do not depend on how long that takes. If the
excitation arrives only after the longest wait, the answer names the steps that were run without it.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from operator import add

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer

from amb_core.excitation import Playback
from amb_core.excitation.playback import WINDOW
from amb_core.ground.errors import ExcitationError
from amb_core.ground.plain_text import plain_text
from amb_core.loop.machine import Machine
from amb_msgs.msg import Excitation, ExcitationStatus
from amb_ros import topics
from amb_ros.alarms import RecentProblem
from amb_ros.excitation_answers import ExcitationAnswers, Identity, answer_to, identity_of
from amb_ros.excitation_messages import Checked, check, read, require_samples, resolve
from amb_ros.qos import EVERY_STATE
from amb_ros.subscriptions import create_subscription

JOIN_TIME = 1.0  # s of wall-clock time for which a controller that joins a run waits for its active excitation
LONGEST_JOIN = 3  # times as long where the topic has a publisher: Fast DDS repeats after 3 s what got lost

Window = Callable[[int], tuple[int, NDArray[np.float64]]]


class ExcitationInput:
    """Topics `excitation` and `excitation_status` of a controller, and what it adds to the nominal reference.

    Parameters
    ----------
    node : Node
        The controller.
    position : callable
        Returns the present run and the last step that needs no answer, 0 and -1 before the first position.
    resume : callable
        Called when an answer to a position need not be delayed any longer.
    machine_of : callable
        Returns the machine of a run, as far as it is known; None before any machine is.

    Attributes
    ----------
    holding : bool
        Whether `holds` may be true; saves the loop the call.
    """

    def __init__(
        self,
        node: Node,
        position: Callable[[], tuple[int, int]],
        resume: Callable[[], None],
        machine_of: Callable[[int], Machine | None],
    ) -> None:
        self.holding = True
        self._node = node
        self._machine_of = machine_of
        self._early: tuple[bytes, int] | None = None  # message that arrived before the machine
        self._position = position
        self._resume = resume
        self._playing: _Playing | None = None
        self._pending: _Pending | None = None
        self._joining: Timer | None = None
        self._joined = False
        self._waits = 0  # of `JOIN_TIME` that are over
        self._joined_at = (0, 0)  # run and step of the first answer without an excitation, if it joined that run
        self._late = RecentProblem()
        self._started = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="excitation")
        self._answers = ExcitationAnswers(node)
        self._subscription = create_subscription(
            node, Excitation, topics.EXCITATION, self._on_excitation, EVERY_STATE, raw=True, with_source_time=True
        )

    def close(self) -> None:
        """Cancel the work in progress."""
        self._pending = None
        self._worker.shutdown(wait=False, cancel_futures=True)

    @property
    def problem(self) -> str:
        """Why an answer waits longer than usual, or which steps were lately run without their excitation; or empty."""
        if self._waits and not self._joined:
            run, step = self._position()
            topic = self._subscription.topic_name
            return (
                f"step {step + 1} of run {run} waits for the excitation that may be under way: {topic} has a publisher"
            )
        return self._late.text

    def reference(self, run: int, step: int, nominal: list[float]) -> list[float]:
        """Reference position of each axis at a step (m) from the nominal one."""
        playing = self._playing
        if playing is None or playing.run != run:
            return nominal
        offset = step - playing.window_step
        if 0 <= offset < playing.window_size or playing.load(step):
            excited = playing.samples[step - playing.window_step]
            return list(map(add, nominal, excited))
        return nominal

    def holds(self, run: int, step: int) -> bool:
        """Whether the answer to a position must wait for the samples of an active excitation."""
        if not self._joined:
            if step == 0:
                self._end_joining()
            else:
                if self._joining is None:
                    clock = Clock(clock_type=ClockType.STEADY_TIME)
                    self._joining = self._node.create_timer(JOIN_TIME, self._on_join_timer, clock=clock)
                return True
        pending = self._pending
        return pending is not None and pending.joins and pending.run == run and step >= pending.first_step

    def take_early(self) -> None:
        """Check the excitation that arrived before the machine was known."""
        early, self._early = self._early, None
        if early is not None:
            self._on_excitation(*early)

    def drop_those_of_others(self, machine: Machine) -> None:
        """Drop what was made for another machine than that which is controlled from now on."""
        if self._pending is not None and self._pending.machine != machine:
            self._call_off("the machine changed before its samples were ready")
        if self._playing is not None and self._playing.machine != machine:
            self._node.get_logger().warning(f"excitation of run {self._playing.run} dropped: the machine changed")
            self._playing = None

    def _keep(self, data: bytes, source_time: int) -> None:
        """Keep a message until the machine is known; only the newest, since an excitation replaces the previous one."""
        if self._early is not None:
            former = read(self._early[0])
            self._answers.refuse(
                answer_to(former),
                "replaced by a later excitation before the machine was known",
            )
        self._early = data, source_time

    # -- messages

    def _on_excitation(self, data: bytes, source_time: int) -> None:
        run, step = self._position()
        latched = 0 < source_time < self._started
        message = read(data)
        if isinstance(message, ExcitationStatus):
            self._answers.refuse(message, message.message)
            self._end_joining()
            return
        resolve(message, run, step)
        machine = self._machine_of(message.run)
        if machine is None:
            self._keep(data, source_time)
            return
        identity = identity_of(message, message.first_step)
        if any(known is not None and known.identity == identity for known in (self._playing, self._pending)):
            return  # published again with its step resolved, or by `ros2 topic pub` every second
        joins = latched and message.first_step != Excitation.FROM_NEXT_STEP
        late = joins and self._joined and message.run == run and message.first_step <= step
        status = answer_to(message)
        try:
            checked = check(message, machine, run, -1 if joins else step)
        except ExcitationError as problem:
            self._answers.refuse(status, str(problem))
            self._end_joining()
            return
        self._call_off(f"replaced by excitation {message.id} before its samples were ready")
        pending = self._pending = _Pending(
            message.run, message.first_step, joins, late, identity, status, checked, machine
        )
        if checked.excitation is None:
            samples = checked.samples
            pending.window = lambda index: (index - index % WINDOW, samples[index - index % WINDOW :][:WINDOW])
            self._finish(pending)
        else:
            self.holding = self.holding or joins
            self._worker.submit(self._make, pending)
        self._end_joining()

    def _call_off(self, reason: str) -> None:
        pending, self._pending = self._pending, None
        if pending is not None:
            self._answers.refuse(pending.status, reason)

    def _make(self, pending: _Pending) -> None:
        """Make the samples; runs in the worker."""
        if pending is not self._pending:
            return
        excitation, checksum = pending.checked.excitation, pending.checked.checksum
        assert excitation is not None
        try:
            machine = pending.machine
            playback = Playback(excitation, machine.sample_rate, machine, lambda: pending is not self._pending)
            require_samples(checksum, playback.checksum)
            pending.window = playback.window
        except ExcitationError as problem:
            pending.problem = str(problem)
        except Exception as problem:  # in every case the sender gets an answer and the loop continues
            self._node.get_logger().error(plain_text(traceback.format_exc()))
            pending.problem = f"internal error while its samples were made: {problem!r}"
        executor = self._node.executor
        if executor is not None and self._node.context.ok():
            executor.create_task(self._finish, pending)

    def _finish(self, pending: _Pending) -> None:
        """Apply an excitation with finished samples from the next step onwards, and answer it."""
        if pending is not self._pending:
            return  # it was replaced and answered meanwhile
        self._pending = None
        run, step = self._position()
        status = pending.status
        problem = pending.problem
        first_step = pending.first_step
        if first_step == Excitation.FROM_NEXT_STEP:
            first_step = step + 1 if pending.run == run else 0
        elif not problem and not pending.joins and pending.run == run and first_step <= step:
            problem = f"step {step} came before its samples were ready; allowed for first_step: {step + 1} or later"
        if not problem and pending.run < run:
            problem = f"meant for run {pending.run}, which ended before its samples were ready; now it is {run}"
        if problem:
            self._answers.refuse(status, problem)
        else:
            if pending.late:
                joined_run, joined_step = self._joined_at
                missed = max(first_step, joined_step if joined_run == run else 0)
                status.message = f"arrived late: steps {missed} to {step} were run without it"
                late = f"excitation {status.id} of run {run} {status.message}"
                self._late.note(late)
                self._node.get_logger().warning(late)
            steps = pending.checked.steps
            identity = (*pending.identity[:-1], first_step)
            self._playing = _Playing(pending.run, first_step, steps, pending.window, identity, pending.machine)
            self._answers.accept(status, first_step, steps)
        self._release()

    # -- joining a run

    def _on_join_timer(self) -> None:
        self._waits += 1
        if self._waits < LONGEST_JOIN and self._node.count_publishers(self._subscription.topic_name):
            return
        run, step = self._position()
        self._joined_at = run, step + 1
        self._end_joining()

    def _end_joining(self) -> None:
        """From now on an active excitation is known, or there is none."""
        if self._joined:
            return
        self._joined = True
        if self._joining is not None:
            self._node.destroy_timer(self._joining)
        self._release()

    def _release(self) -> None:
        """Let the loop continue if nothing delays it any longer."""
        if self.holding and self._joined and (self._pending is None or not self._pending.joins):
            self.holding = False
            self._resume()


@dataclass(eq=False)
class _Pending:
    """An excitation whose samples are being made."""

    run: int
    first_step: int
    joins: bool  # it was active before this controller started
    late: bool  # and arrived after the controller had answered some of its steps without it
    identity: Identity
    status: ExcitationStatus
    checked: Checked
    machine: Machine
    problem: str = ""
    window: Window = lambda _index: (0, np.zeros((0, 2)))


class _Playing:
    """An excitation being applied, with a window of its samples as plain floats for fast access."""

    __slots__ = ("_window", "first_step", "identity", "machine", "run", "samples", "stop", "window_size", "window_step")

    def __init__(
        self, run: int, first_step: int, steps: int, window: Window, identity: Identity, machine: Machine
    ) -> None:
        self.run = run
        self.machine = machine
        self.first_step = first_step
        self.stop = first_step + steps
        self.identity = identity
        self.window_step = 0  # of the first sample in the window
        self.window_size = 0
        self.samples: list[list[float]] = []  # of all axes, step by step
        self._window = window

    def load(self, step: int) -> bool:
        """Load the window with the sample of a step; false if there is none."""
        if not self.first_step <= step < self.stop:
            return False
        first, samples = self._window(step - self.first_step)
        self.window_step, self.window_size = self.first_step + first, len(samples)
        self.samples = samples.tolist()
        return True
