"""Periodic health report of a node on /diagnostics, including nodes and publishers of which only one may run."""

from __future__ import annotations

import os
import platform
import uuid
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.ground.errors import bounded
from amb_ros.alarms import AlarmRecord
from amb_ros.namesakes import Namesakes

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
Report = tuple[bytes, str, Mapping[str, object]]
"""Level, summary and key-value pairs."""

TOPIC = "/diagnostics"
INSTANCE = "instance"
"""Key whose value differs between two nodes of one name: process and computer, and a number of its own."""
UNKNOWN_NODES = ("", "_NODE_NAME_UNKNOWN_")
"""Names that rmw gives the node of a publisher as long as it knows the publisher alone, as at the start of the node."""
LAST_ALARM = "last alarm"
"""Key whose value is the last WARN or ERROR that is over, with its times."""


class DiagnosticsReporter:
    """Publishes what `report` returns every `period` seconds of wall-clock time, and on `publish`.

    A second node of the same name is an ERROR of both. An alarm that is over stays in the value `last alarm`.

    Parameters
    ----------
    node : Node
        The node.
    report : callable
        Returns the present state.
    period : float, optional
        Wall-clock time between two reports (s).
    exclusive : sequence of str, optional
        Topics that only one node may publish. If two nodes do, the report is an ERROR that names them.
    """

    def __init__(
        self, node: Node, report: Callable[[], Report], period: float = 0.5, exclusive: Sequence[str] = ()
    ) -> None:
        self._node = node
        self._report = report
        self._exclusive = [node.resolve_topic_name(topic) for topic in exclusive]
        self._instance = f"process {os.getpid()} on {platform.node()}, {uuid.uuid4().hex}"
        self._namesakes = Namesakes()
        self._alarms = AlarmRecord()
        self._conflicts: list[str] = []  # at the last report
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, 10)
        self._subscription = node.create_subscription(DiagnosticArray, TOPIC, self._on_report, 100)
        self._clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._timer = node.create_timer(period, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publish the present state now; nothing once the node is being shut down."""
        if not self._node.context.ok():
            return
        level, summary, values = self._report()
        name = self._node.get_fully_qualified_name().lstrip("/")
        self._namesakes.note(name, self._instance)
        conflicts = self.conflicts()
        self._log(conflicts)
        if conflicts:
            level, summary = ERROR, "; ".join([*conflicts, summary])
        now = self._clock.now()
        summary = bounded(summary)
        self._alarms.note(level[0], summary, as_text(now.nanoseconds))
        values = {**values, LAST_ALARM: self._alarms.last or "none", INSTANCE: self._instance}
        status = DiagnosticStatus(
            level=level,
            name=name,
            message=summary,
            hardware_id="amb",
            values=[KeyValue(key=key, value=bounded(str(value))) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)

    def conflicts(self) -> list[str]:
        """Nodes of which there are two, and exclusive topics that more than one node publishes, one text each."""
        namesakes = self.namesakes()
        texts = [namesakes] if namesakes else []
        for topic in self._exclusive:
            ends = self._node.get_publishers_info_by_topic(topic)
            known = [end for end in ends if end.node_name not in UNKNOWN_NODES]
            names = {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in known}
            twice = {name for name in names if self._namesakes.lives_twice(name.lstrip("/"))}
            publishers = sorted([*names, *twice])
            if len(publishers) > 1:
                texts.append(f"{len(publishers)} nodes publish {topic}: {', '.join(publishers)}; stop all but one")
        return texts

    def namesakes(self) -> str:
        """That other nodes of this node's name run, with their processes; empty if there are none."""
        name = self._node.get_fully_qualified_name()
        if not self._namesakes.lives_twice(name.lstrip("/")):
            return ""
        instances = self._namesakes.instances(name.lstrip("/"))
        processes = ", ".join(sorted(instance.rpartition(", ")[0] or instance for instance in instances))
        return f"{len(instances)} nodes are named {name}: {processes}; stop all but one"

    def _log(self, conflicts: list[str]) -> None:
        """Log conflicts when they begin and end."""
        for text in conflicts:
            if text not in self._conflicts:
                self._node.get_logger().error(bounded(text))
        if self._conflicts and not conflicts:
            self._node.get_logger().info(f"no longer: {bounded('; '.join(self._conflicts))}")
        self._conflicts = conflicts

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            for item in status.values:
                if item.key == INSTANCE and item.value != self._instance:  # which was noted when it was sent
                    self._namesakes.note(status.name, item.value)


def as_text(nanoseconds: int) -> str:
    """A wall-clock time (ns since the epoch) as text, in UTC."""
    return datetime.fromtimestamp(1e-9 * nanoseconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
