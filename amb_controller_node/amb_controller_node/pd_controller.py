"""Node `pd_controller`: the control law of amb_core behind topics.

It answers every position with the current reference of the same run and step, adds the excitation to the nominal
reference, and publishes telemetry in blocks. A position that arrives twice gets the same answer. A new run, or a gap in
the steps, restarts the control law.
"""

from __future__ import annotations

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_controller_node.excitation_input import ExcitationInput
from amb_controller_node.parameters import PdControllerParameters
from amb_core.loop.control import PdController
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.recording.messages.time_stamp import last_stamped_step
from amb_msgs.msg import CurrentReference, LoopSamples, RotorPosition
from amb_ros import diagnostics, topics
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import HISTORY, STREAM
from amb_ros.sample_messages import pack_current, unpack_position

SIGNALS = ("reference_x", "reference_y", "position_x", "position_y", "current_x", "current_y")
AXES = 2
FLUSH_PERIOD = 0.1  # s of wall-clock time without a sample after which a partial block of telemetry is published
LARGEST_POSITION = 1.0  # m; far above every clearance, and far below values that would overflow in the control law


class PdControllerNode(Node):
    """The controller. Topics and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__(
            "pd_controller", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        self._settings = declare(
            self, PdControllerParameters, self._on_parameters, check=lambda values: values.require_axes(AXES)
        )
        self._controller = PdController(self._settings, AXES)
        self._controller.update((0.0, 0.0), (0.0, 0.0))  # compile before the first position arrives
        self._run = 0
        self._step = -1  # last step answered
        self._gaps = 0
        self._rate_error = ""
        self._last_step = last_stamped_step(self._settings.sample_rate)  # that a message can carry
        self._refused_positions = 0
        self._position_error = ""  # of this run
        self._answer = b""  # to the last step
        self._held = b""  # position whose answer waits for the excitation
        self._telemetry = _TelemetryBlock(self._settings.sample_rate)
        self._flushed_step = -1

        self._current_publisher = self.create_publisher(CurrentReference, topics.CURRENT_REFERENCE, STREAM)
        self._telemetry_publisher = self.create_publisher(LoopSamples, topics.TELEMETRY, HISTORY)
        # Before the positions, so that an active excitation is known as early as they are.
        self._excitation = ExcitationInput(self, self._settings.sample_rate, self._place, self._answer_held)
        self._position_subscription = self.create_subscription(
            RotorPosition, topics.POSITION, self._on_position, STREAM, raw=True
        )
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.TELEMETRY, topics.CURRENT_REFERENCE, topics.POSITION)
        )
        self._flush_timer = self.create_timer(
            FLUSH_PERIOD, self._on_flush_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def destroy_node(self) -> None:
        """Cancel an excitation that is being made, and end the node."""
        self._excitation.close()
        super().destroy_node()

    # -- the loop

    def _on_position(self, data: bytes) -> None:
        run, step, time, x, y = unpack_position(data)
        # A NaN fails every comparison.
        if not (abs(x) <= LARGEST_POSITION and abs(y) <= LARGEST_POSITION and step <= self._last_step):
            self._refuse_position(run, step, x, y)
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
        reference_x, reference_y = self._excitation.reference(run, step, *self._controller.nominal_reference.tolist())
        i_x, i_y = self._controller.update((x, y), (reference_x, reference_y)).tolist()
        self._answer = pack_current(run, step, i_x, i_y)
        self._current_publisher.publish(self._answer)
        self._telemetry.add(step, reference_x, reference_y, x, y, i_x, i_y)
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
        self._controller.reset()
        if run == self._run:
            self._gaps += 1
            self.get_logger().warning(f"position of step {step} follows step {self._step} of run {run}: law restarted")
        else:
            self._position_error = ""
        self._run = run
        self._rate_error = ""

    def _refuse_position(self, run: int, step: int, x: float, y: float) -> None:
        """Do not answer a position that would corrupt the controller state, and report it until the next run."""
        self._refused_positions += 1
        error = (
            f"position x = {x:g} m, y = {y:g} m at step {step} of run {run} is not answered; allowed: finite values up "
            f"to {LARGEST_POSITION:g} m and steps up to {self._last_step}"
        )
        self.get_logger().error(error, throttle_duration_sec=5.0)
        if not self._position_error:
            self._position_error = error
            self._diagnostics.publish()

    def _check_sample_rate(self, period: float) -> None:
        rate = self._settings.sample_rate
        if not abs(period * rate - 1.0) <= 1e-3:  # NaN too
            found = f"at {1.0 / period:g} Hz" if period > 0.0 else f"with time {period:g} s at step 1"
            self._rate_error = (
                f"positions arrive {found}, but the controller has sample_rate = {rate:g} Hz; set both to the same rate"
            )
            self.get_logger().error(self._rate_error)

    def _on_parameters(self, parameters: PdControllerParameters) -> None:
        self._settings = parameters
        self._controller.configure(parameters)

    # -- telemetry

    def _flush(self) -> None:
        if len(self._telemetry):
            self._telemetry_publisher.publish(self._telemetry.take(self._run))

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
        if self._position_error:
            return diagnostics.ERROR, self._position_error, values
        if self._rate_error:
            return diagnostics.ERROR, self._rate_error, values
        return diagnostics.OK, "answering" if self._step >= 0 else "no position yet", values


class _TelemetryBlock:
    """The samples since the last block was published, one after the other in a flat list."""

    def __init__(self, sample_rate: float) -> None:
        self._sample_rate = sample_rate
        self._first_step = 0
        self._samples: list[float] = []

    def __len__(self) -> int:
        return len(self._samples) // len(SIGNALS)

    def add(self, step: int, *sample: float) -> None:
        if not self._samples:
            self._first_step = step
        self._samples.extend(sample)

    def take(self, run: int) -> LoopSamples:
        """The block as a message; the next sample starts a new one."""
        samples = np.array(self._samples).reshape(len(self), len(SIGNALS))
        record = LoopRecord(self._first_step, 1.0 / self._sample_rate, samples[:, :2], samples[:, 2:4], samples[:, 4:])
        self._samples.clear()
        return fill_loop_samples(LoopSamples(), run, record)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(PdControllerNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
