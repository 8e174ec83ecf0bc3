"""Topics `signals/<axis>`: samples of the loop for tools that plot, which want one stamped sample a message.

They are taken from finished blocks of telemetry, so the loop does nothing for them, and nothing is made that nobody
listens to.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from rclpy.node import Node
from rclpy.publisher import Publisher

from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.time_stamp import set_step_time
from amb_msgs.msg import AxisSignals
from amb_ros import topics
from amb_ros.qos import STREAM


class AxisSignalPublishers:
    """A publisher for each axis of a machine.

    Parameters
    ----------
    node : Node
        The node that publishes the telemetry.
    rate : float
        Messages per second of loop time (Hz), at most one a step; 0 for none.

    Attributes
    ----------
    rate : float
        As the parameter; may be changed.
    """

    def __init__(self, node: Node, rate: float) -> None:
        self.rate = rate
        self._node = node
        self._publishers: dict[str, Publisher] = {}

    def use(self, axes: Iterable[str]) -> None:
        """Publish the signals of these axes from now on."""
        # A name that is no name of a topic is not one of ours.
        wanted = [axis for axis in axes if re.fullmatch(r"[A-Za-z]\w*", axis, re.ASCII)]
        for axis in self._publishers.keys() - wanted:
            self._node.destroy_publisher(self._publishers.pop(axis))
        for axis in wanted:
            if axis not in self._publishers:
                self._publishers[axis] = self._node.create_publisher(AxisSignals, topics.signals(axis), STREAM)

    def publish(self, run: int, block: LoopRecord) -> None:
        """Publish the samples of a block that are due: those of every so many steps of the run."""
        if self.rate <= 0.0:
            return
        every = max(round(1.0 / (self.rate * block.sample_time)), 1)
        for column, axis in enumerate(block.axes):
            publisher = self._publishers.get(axis)
            if publisher is None or not publisher.get_subscription_count():
                continue
            for row in range(-block.first_step % every, block.steps, every):
                message = AxisSignals(
                    run=run,
                    step=block.first_step + row,
                    position=float(block.position[row, column]),
                    reference=float(block.reference[row, column]),
                    control_current=float(block.current[row, column]),
                )
                message.header.frame_id = axis
                set_step_time(message.header.stamp, message.step, 1.0 / block.sample_time)
                publisher.publish(message)
