"""Which publishers of a topic that only one node may publish a report on /diagnostics takes for a conflict."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from amb_ros.diagnostics import OK, DiagnosticsReporter

UNKNOWN = ("_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_")
PD, SPACE = ("/amb", "pd_controller"), ("/amb", "state_space_controller")


@pytest.mark.parametrize(
    ("ends", "conflicts"),
    [
        ([PD, PD], []),  # a killed node stays in the graph for a while beside its replacement
        ([PD, UNKNOWN], []),  # whose name comes after its publishers
        ([UNKNOWN, UNKNOWN], []),
        (
            [PD, SPACE, UNKNOWN],
            ["2 nodes publish /amb/telemetry: /amb/pd_controller, /amb/state_space_controller; stop all but one"],
        ),
    ],
)
def test_a_publisher_counts_once_its_node_has_a_name(ends: list[tuple[str, str]], conflicts: list[str]) -> None:
    node = Mock()
    node.get_fully_qualified_name.return_value = "/amb/pd_controller"
    node.resolve_topic_name.side_effect = "/amb/{}".format
    node.get_publishers_info_by_topic.return_value = [
        SimpleNamespace(node_namespace=namespace, node_name=name) for namespace, name in ends
    ]
    reporter = DiagnosticsReporter(node, lambda: (OK, "answering", {}), exclusive=("telemetry",))
    assert reporter.conflicts() == conflicts
