"""What every controller node shares: a control law of amb_core behind topics.

It answers every position with the current reference of the same run and step, adds the excitation to the nominal
reference, and publishes telemetry in blocks. A position that arrives twice gets the same answer. A new run, or a gap in
the steps, restarts the control law. Axes and sample rate are those of the machine, fixed within a run.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node

from amb_controller_node.excitation_input import ExcitationInput
from amb_controller_node.parameters import CommonParameters
from amb_core.ground.errors import AmbError, MessageError, one_line
from amb_core.loop.law import ControlLaw
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.recording.messages.time_stamp import last_stamped_step
from amb_msgs.msg import AxisSamples, CurrentReference, LoopSamples, RotorPosition
from amb_ros import diagnostics, topics
from amb_ros.alarms import RecentProblem
from amb_ros.machine import MachineInput
from amb_ros.parameters import declare
from amb_ros.qos import HISTORY, STREAM
from amb_ros.sample_messages import pack_current, unpack_position
from amb_ros.signals import AxisSignalPublishers

RIG = "bridge"  # source of a machine that is no simulated one
FLUSH_PERIOD = 0.1  # s of wall-clock time without a sample after which a partial block of telemetry is published
DELIVERY = Duration(seconds=0.5)  # longest wait at the end until the last telemetry has arrived everywhere
LARGEST_POSITION = 1.0  # m; far above every clearance, and far below values that would overflow in the control law


class ControllerNode(Node):
    """A controller; each kind is a subclass. Topics and parameters: see the package's README.

    Parameters
    ----------
    name : str
        Of the node.
    parameters : type[CommonParameters]
        Its parameters.
    """

    def __init__(self, name: str, parameters: type[CommonParameters]) -> None:
        super().__init__(name, namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._machine: Machine | None = None  # that of the present run
        self._axes: tuple[str, ...] = ()  # of it
        self._outdated = False  # whether the law is to be made anew for the next run
        self._step_at_change = -1  # last step answered when the latest machine arrived
        self._machine_error = ""  # why the latest machine cannot be controlled, or the present run's is another
        self._start: Any = None  # the parameters that the operator gave; later changes come from anybody
        self._settings: Any = declare(self, parameters, self._on_parameters, self._check_parameters)
        self._start = self._settings
        self._law: ControlLaw | None = None  # for it
        self._nominal_reference: list[float] = []
        self._run = 0
        self._step = -1  # last step answered
        self._gaps = 0
        self._rate_error = ""
        self._last_step = 0  # that a message can carry
        self._refused_positions = 0
        self._position_error = RecentProblem()
        self._refused_after = (0, -1)  # run and last step answered when a position was last refused
        self._answer = b""  # to the last step
        self._held = b""  # position whose answer waits for the excitation or for the machine
        self._telemetry = _TelemetryBlock()
        self._flushed_step = -1

        self._current_publisher = self.create_publisher(CurrentReference, topics.CURRENT_REFERENCE, STREAM)
        self._telemetry_publisher = self.create_publisher(LoopSamples, topics.TELEMETRY, HISTORY)
        self._signals = AxisSignalPublishers(self, self._settings.signals_rate)
        # Before the positions, so that an active excitation is known as early as they are.
        self._excitation = ExcitationInput(self, self._place, self._answer_held, self._machine_of)
        self._machine_input = MachineInput(self, self._on_machine)
        self._position_subscription = self.create_subscription(
            RotorPosition, topics.POSITION, self._on_position, STREAM, raw=True
        )
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.TELEMETRY, topics.CURRENT_REFERENCE, topics.POSITION)
        )
        self._flush_timer = self.create_timer(
            FLUSH_PERIOD, self._on_flush_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def let_go(self) -> None:
        """Publish the samples since the last block of telemetry."""
        if self.context.ok():
            self._flush()
            self._telemetry_publisher.wait_for_all_acked(DELIVERY)

    def finish(self) -> None:
        """Cancel an excitation that is being made."""
        self._excitation.close()

    # -- the loop

    def _on_position(self, data: bytes) -> None:
        try:
            run, step, time, position = unpack_position(data)
        except MessageError as problem:
            self._refuse(f"a position is not answered: {problem}")
            return
        if (run != self._run or self._machine is None) and not self._use_machine(data, run, len(position)):
            return
        if step > self._last_step or len(position) != len(self._axes) or not _all_within(LARGEST_POSITION, position):
            self._refuse_position(run, step, position)
            return
        if self._excitation.holding and self._excitation.holds(run, step):
            self._held = data
            return
        if run != self._run or step != self._step + 1:
            if run == self._run and step == self._step:
                self._current_publisher.publish(self._answer)
                return
            self._start_afresh(run, step)
        self._step = step
        reference = self._excitation.reference(run, step, self._nominal_reference)
        assert self._law is not None  # with the machine
        current = self._law.update(position, reference).tolist()
        self._answer = pack_current(run, step, current)
        self._current_publisher.publish(self._answer)
        self._telemetry.add(step, reference, position, current)
        if len(self._telemetry) >= self._settings.telemetry_block:
            self._flush()
        if step == 1:
            self._check_sample_rate(time)

    def _place(self) -> tuple[int, int]:
        """The present run, and the last step that needs no answer from this controller any more."""
        if self._held:
            run, step, *_ = unpack_position(self._held)
            return run, step - 1
        return self._run, self._step

    def _answer_held(self) -> None:
        held, self._held = self._held, b""
        if held:
            self._on_position(held)

    def _start_afresh(self, run: int, step: int) -> None:
        self._flush()
        if self._law is not None:
            self._law.reset()
        if run == self._run:
            self._gaps += 1
            self.get_logger().warning(f"position of step {step} follows step {self._step} of run {run}: law restarted")
        self._run = run
        self._rate_error = ""

    def _on_machine(self, _machine: Machine) -> None:
        """Answer what has waited for the machine. One that changes anything within a run applies from the next on."""
        self._step_at_change = self._step
        self._excitation.take_early()
        self._answer_held()

    def _machine_of(self, run: int) -> Machine | None:
        """The machine of a run: that with which the present one began, the latest of any other."""
        return self._machine if run == self._run and self._machine is not None else self._machine_input.machine

    def _use_machine(self, data: bytes, run: int, count: int) -> bool:
        """Use the latest machine from the first position of a run on; if it cannot be that of the position, hold it."""
        machine = self._machine_input.machine
        self._machine_error = ""
        if machine is None:
            self._machine_error = self._machine_input.problem
        elif count != len(machine.axes):
            self._machine_error = (
                f"position of {count} axes in run {run}, but the machine {machine.name!r} has {len(machine.axes)}, "
                f"{', '.join(machine.axis_names)}; waiting for the machine of this run"
            )
        elif machine != self._machine or self._outdated:
            self._take_machine(machine)
        if self._machine_error:
            self._held = data
            self._diagnostics.publish()
        return not self._machine_error

    def _take_machine(self, machine: Machine) -> None:
        """Control a machine; if the parameters are not for it, the reason is kept as an error."""
        try:
            if machine.source == RIG:
                self._start.allowed.require(self._settings, self._start)
            law = self.law_for(machine, self._settings)
        except AmbError as problem:
            self._machine_error = f"{one_line(problem)}; no position of machine {machine.name!r} is answered"
            self.get_logger().error(self._machine_error, throttle_duration_sec=5.0)
            return
        self._flush()  # of the last run
        self._law, self._nominal_reference = law, law.nominal_reference.tolist()
        self._machine, self._axes, self._outdated = machine, machine.axis_names, False
        self._last_step = last_stamped_step(machine.sample_rate)
        self._signals.use(self._axes)
        self._excitation.drop_those_of_others(machine)

    def _refuse_position(self, run: int, step: int, position: Sequence[float]) -> None:
        """Do not answer a position that would corrupt the controller state, and report it until others follow."""
        shown = ", ".join(f"{value:g}" for value in position[: len(self._axes) + 1])
        self._refuse(
            f"position {shown} m at step {step} of run {run} is not answered; allowed: finite values up to "
            f"{LARGEST_POSITION:g} m of the {len(self._axes)} axes {', '.join(self._axes)}, and steps up to "
            f"{self._last_step}"
        )

    def _refuse(self, error: str) -> None:
        self._refused_positions += 1
        self.get_logger().error(error, throttle_duration_sec=5.0)
        self._refused_after = self._run, self._step
        if self._position_error.note(error):
            self._diagnostics.publish()

    def _check_sample_rate(self, period: float) -> None:
        rate = self._sample_rate()
        if not abs(period * rate - 1.0) <= 1e-3:  # NaN too
            observed = f"at {1.0 / period:g} Hz" if period > 0.0 else f"with time {period:g} s at step 1"
            self._rate_error = (
                f"positions arrive {observed}, but the machine has a sample rate of {rate:g} Hz; its source must "
                "publish the rate at which it runs"
            )
            self.get_logger().error(self._rate_error)

    def _on_parameters(self, parameters: Any) -> None:
        self._settings = parameters
        if self._law is not None:
            self.configure(self._law, parameters)
            self._nominal_reference = self._law.nominal_reference.tolist()
        self._answer_held()

    def _check_parameters(self, parameters: Any) -> None:
        """Refuse lists for another number of axes than the machine has; at a rig, what its operator has not allowed."""
        if self._axes:
            parameters.require_axes(len(self._axes))
        if self._start is not None and self._machine is not None and self._machine.source == RIG:
            self._start.allowed.require(parameters, self._start)

    # -- what a kind of controller gives

    @abstractmethod
    def law_for(self, machine: Machine, parameters: Any) -> ControlLaw:
        """The control law for a machine, from parameters of the node.

        Raises
        ------
        AmbError
            If there is none that fits the machine.
        """

    @abstractmethod
    def configure(self, law: Any, parameters: Any) -> None:
        """Use changed parameters in a law from the next sample onwards."""

    def _sample_rate(self) -> float:
        assert self._machine is not None
        return self._machine.sample_rate

    def renew_law(self) -> None:
        """Make the law anew for the next run, from what the controller has received."""
        self._outdated = True
        self._answer_held()

    # -- telemetry

    def _flush(self) -> None:
        if len(self._telemetry):
            block = self._telemetry.take(1.0 / self._sample_rate(), self._axes)
            self._telemetry_publisher.publish(fill_loop_samples(LoopSamples(), AxisSamples, self._run, block))
            self._signals.publish(self._run, block)

    def _on_flush_timer(self) -> None:
        """Publish a partial block if no sample has arrived since the last call: the run is paused or over."""
        if self._step == self._flushed_step:
            self._flush()
        self._flushed_step = self._step

    # -- health

    def _report(self) -> diagnostics.Report:
        values = {
            "run": self._run,
            "step": self._step,
            "gaps in the steps": self._gaps,
            "positions refused": self._refused_positions,
        }
        stands = self._refused_after == (self._run, self._step)  # the loop, since a position was refused
        refused = self._position_error.last if stands else self._position_error.text
        for error in (self._machine_error, refused, self._rate_error, self._changed_machine()):
            if error:
                return diagnostics.ERROR, error, values
        if warning := self._machine_input.problem or self._excitation.problem:
            return diagnostics.WARN, warning, values
        return diagnostics.OK, "answering" if self._step >= 0 else "no position yet", values

    def _changed_machine(self) -> str:
        """What is wrong if the machine is another one than that with which the present run began, and still goes on."""
        latest = self._machine_input.machine
        if latest == self._machine or self._machine is None or self._step <= self._step_at_change:
            return ""
        return (
            f"the machine changed within run {self._run}: it began with axes {', '.join(self._axes)} at "
            f"{self._sample_rate():g} Hz, which hold until its end"
        )


def _all_within(limit: float, values: Sequence[float]) -> bool:
    return all(-limit <= value <= limit for value in values)  # a NaN fails every comparison


class _TelemetryBlock:
    """The samples since the last block was published."""

    def __init__(self) -> None:
        self._first_step = 0
        self._samples: list[tuple[Sequence[float], Sequence[float], Sequence[float]]] = []

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, step: int, reference: Sequence[float], position: Sequence[float], current: Sequence[float]) -> None:
        """Add reference, position and current of all axes at a step."""
        if not self._samples:
            self._first_step = step
        self._samples.append((reference, position, current))

    def take(self, sample_time: float, axes: tuple[str, ...]) -> LoopRecord:
        """The block; the next sample starts a new one."""
        reference, position, current = np.array(self._samples).swapaxes(0, 1)
        record = LoopRecord(self._first_step, sample_time, reference, position, current, axes)
        self._samples.clear()
        return record
