"""The telemetry of the present run of a graph, in this process: samples between two steps, once they are there."""

from __future__ import annotations

from amb_bringup.client.connection import GraphConnection
from amb_core.ground.errors import BagError
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import StepCoverage, merge_blocks
from amb_core.recording.messages.loop_samples import block_from_message
from amb_msgs.msg import LoopSamples, RegionState
from amb_ros import topics
from amb_ros.qos import HISTORY
from amb_ros.subscriptions import create_subscription


class LiveTelemetry:
    """Keeps the telemetry of the newest run, and the highest region in each span of it.

    Parameters
    ----------
    client : GraphConnection
        In the graph.
    """

    def __init__(self, client: GraphConnection) -> None:
        self._client = client
        self._run = 0
        self._blocks: list[LoopRecord] = []
        self._coverage = StepCoverage()
        self._regions: list[RegionState] = []
        create_subscription(client.node, LoopSamples, topics.TELEMETRY, self._on_telemetry, HISTORY)
        create_subscription(client.node, RegionState, topics.REGION, self._regions.append, HISTORY)

    def record(self, run: int, first_step: int, stop: int) -> LoopRecord:
        """Samples of a run from a step to before another; waits until they have arrived.

        Raises
        ------
        ClientError
            If they do not arrive in time.
        BagError
            If samples between were lost.
        """
        self._client.wait_until(
            lambda: self._run == run and self._coverage.stop >= stop,
            complaint=f"telemetry of run {run} up to step {stop - 1} did not arrive",
        )
        return merge_blocks(self._blocks, first_step, stop)

    def highest_region(self, run: int, first_step: int, stop: int) -> int:
        """The highest region of the monitor between two steps of a run; waits until it has seen them all.

        Raises
        ------
        ClientError
            If the monitor does not get so far in time.
        """

        def seen() -> list[RegionState]:
            return [state for state in self._regions if state.run == run]

        self._client.wait_until(
            lambda: any(state.next_step >= stop for state in seen()),
            complaint=f"region_monitor has not reached step {stop} of run {run}",
        )
        return max((state.region for state in seen() if first_step <= state.step < stop), default=0)

    def _on_telemetry(self, message: LoopSamples) -> None:
        try:
            block = block_from_message(message)
        except BagError:  # of anybody; samples that are missing are reported when they are asked for
            return
        if message.run > self._run:
            self._run, self._blocks, self._coverage = int(message.run), [], StepCoverage()
        if message.run == self._run:
            self._blocks.append(block)
            self._coverage.add(block.first_step, block.steps)
