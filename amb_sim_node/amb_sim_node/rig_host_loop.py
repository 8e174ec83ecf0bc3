"""The loop of a rig over topics, as the simulator has it: each position goes out, each current comes back.

The controller node plays the excitations and publishes the telemetry. Before a levitation one position is published in
a run of its own, so that a controller that is missing is a refusal and not a trip.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node

from amb_core.ground.errors import MessageError, TargetError
from amb_core.rig import Runs
from amb_core.rig.link import HostLoopLink, TargetState, TelemetryBlock
from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros import topics
from amb_ros.alarms import RecentProblem
from amb_ros.qos import STREAM
from amb_ros.sample_messages import pack_position, unpack_current

STATE = 0b111  # of the status word
REPEAT = 0.2  # s after which a position of the rehearsal is published again
PATIENCE = 10.0  # s, for its answer: a controller may have to load its law first


class HostLoop:
    """Topics `position` and `current_reference` of the bridge.

    Parameters
    ----------
    node : Node
        The bridge.
    link_of : callable
        Returns the link; None while the bridge is not configured.
    """

    def __init__(self, node: Node, link_of: Callable[[], HostLoopLink | None]) -> None:
        self._node, self._link_of = node, link_of
        self._runs: Runs | None = None  # that of the latest sample
        self._rehearsed = 0  # run
        self._axes = 0  # of the positions
        self._refused = 0  # currents
        self._problem = RecentProblem()
        self._answered = threading.Event()
        self._publisher = node.create_publisher(RotorPosition, topics.POSITION, STREAM)
        self._subscription = node.create_subscription(
            CurrentReference, topics.CURRENT_REFERENCE, self._on_current, STREAM, raw=True
        )

    def pass_on(self, samples: TelemetryBlock, runs: Runs, sample_rate: float) -> None:
        """Publish the positions of a levitated rotor; while it lands, the target has the loop."""
        assert samples.status is not None
        self._runs, self._axes = runs, samples.position.shape[1]
        for row, state in enumerate((samples.status & STATE).tolist()):
            if state in (TargetState.LEVITATING, TargetState.LEVITATED):
                step = runs.step_of(samples.first_step + row)
                self._publish(runs.run, step, step / sample_rate, samples.position[row].tolist())

    def rehearse(self, run: int, position: Sequence[float]) -> None:
        """Wait until a controller answers a position (m), in a run of its own.

        Raises
        ------
        TargetError
            If none does.
        """
        self._answered.clear()
        self._rehearsed, self._axes = run, len(position)
        until = time.monotonic() + PATIENCE
        while not self._answered.wait(REPEAT):
            if time.monotonic() > until:
                raise TargetError(
                    f"no answer on {topics.CURRENT_REFERENCE} within {PATIENCE:g} s; listening on {topics.POSITION}: "
                    f"{self._publisher.get_subscription_count()}; start a controller node, such as pd_controller, or "
                    "see its diagnostics"
                )
            self._publish(run, 0, 0.0, position)

    def _publish(self, run: int, step: int, time_: float, position: Sequence[float]) -> None:
        if self._node.context.ok():
            self._publisher.publish(pack_position(run, step, time_, position))

    @property
    def problem(self) -> str:
        """That currents were refused lately, and why the last one; empty if none was."""
        return self._problem.text

    def _on_current(self, data: bytes) -> None:
        try:
            run, step, current = unpack_current(data)
            if len(current) != self._axes:
                raise MessageError(f"step {step} of run {run} has {len(current)} values; allowed: {self._axes}")
        except MessageError as problem:
            self._refused += 1
            self._problem.note(f"{self._refused} messages on {topics.CURRENT_REFERENCE} refused, the last: {problem}")
            self._node.get_logger().error(self._problem.last, throttle_duration_sec=5.0)
            return
        link, runs = self._link_of(), self._runs
        if run == self._rehearsed:
            self._answered.set()
        elif link is not None and runs is not None and run == runs.run and runs.levitated:
            link.send_current(runs.target_step_of(step), current)
