"""What clients and displays make of messages that no node of the workbench sends."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from amb_bringup.client import live_telemetry
from amb_bringup.client.live_telemetry import LiveTelemetry
from amb_bringup.view.foxglove_bridge import log_time
from amb_msgs.msg import AxisSamples, LoopSamples
from amb_ros.rejections import KEPT_REASONS, RejectionListener


def block(first_step: int, steps: int) -> LoopSamples:
    values = [0.0] * steps
    axes = [AxisSamples(name=name, reference=values, position=values, current=values) for name in "xy"]
    return LoopSamples(run=1, first_step=first_step, sample_time=1e-4, axes=axes)


class Node:
    """Keeps the callback of a subscription."""

    def create_subscription(self, _type: Any, _topic: str, callback: Any, _qos: Any) -> None:
        self.receive = callback


def test_malformed_telemetry_does_not_end_what_a_client_waits_for(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: dict[str, Any] = {}
    monkeypatch.setattr(
        live_telemetry,
        "create_subscription",
        lambda _node, _type, topic, callback, _qos: heard.update({topic: callback}),
    )
    client: Any = SimpleNamespace(node=None, wait_until=lambda condition, complaint: None)
    telemetry = LiveTelemetry(client)
    for message in (block(0, 10), block(10, 0), LoopSamples(run=1), block(10, 10)):
        heard["telemetry"](message)
    assert telemetry.record(1, 0, 20).steps == 20


@pytest.mark.parametrize("step", [0, 1, 2**64 - 1])
@pytest.mark.parametrize("sample_time", [math.nan, math.inf, -1.0, 0.0, 1e300])
def test_a_state_of_no_run_has_no_time(step: int, sample_time: float) -> None:
    assert log_time(step, sample_time) is None or (step, sample_time) == (0, 1e300)


def test_a_state_of_a_run_has_the_time_of_its_step() -> None:
    assert log_time(20_000, 1e-4) == 2_000_000_000


def test_reasons_of_rejections_take_bounded_memory() -> None:
    node: Any = Node()
    listener = RejectionListener(node, "identify")
    for number in range(KEPT_REASONS + 50):
        node.receive(SimpleNamespace(key=str(number), value="no"))
    assert len(listener._reasons) == KEPT_REASONS
