"""Periodic health report of a node on /diagnostics, including topics with more publishers than allowed."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_ros.namesakes import Namesakes

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
Report = tuple[bytes, str, Mapping[str, object]]
"""Level, summary and key-value pairs."""

TOPIC = "/diagnostics"
INSTANCE = "instance"
"""Key whose value differs between two nodes of one name."""


class DiagnosticsReporter:
    """Publishes what `report` returns every `period` seconds of wall-clock time, and on `publish`.

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
        self._instance = uuid.uuid4().hex
        self._namesakes = Namesakes(patience=3.0 * period)
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
        if conflicts := self.conflicts():
            level, summary = ERROR, "; ".join([*conflicts, summary])
        status = DiagnosticStatus(
            level=level,
            name=name,
            message=summary,
            hardware_id="amb",
            values=[KeyValue(key=key, value=str(value)) for key, value in {**values, INSTANCE: self._instance}.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._clock.now().to_msg()
        self._publisher.publish(array)

    def conflicts(self) -> list[str]:
        """The exclusive topics that more than one node publishes, one text each."""
        texts = []
        for topic in self._exclusive:
            ends = self._node.get_publishers_info_by_topic(topic)
            names = {f"{end.node_namespace.rstrip('/')}/{end.node_name}" for end in ends}
            twice = {name for name in names if self._namesakes.lives_twice(name.lstrip("/"))}
            publishers = sorted([*names, *twice])
            if len(publishers) > 1:
                texts.append(f"{len(publishers)} nodes publish {topic}: {', '.join(publishers)}; stop all but one")
        return texts

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            for item in status.values:
                if item.key == INSTANCE:
                    self._namesakes.note(status.name, item.value)
