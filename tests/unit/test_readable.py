"""A recorder takes what readers of its bag understand, and refuses the rest with the reason."""

from __future__ import annotations

from array import array
from typing import Any

import pytest
from rclpy.serialization import deserialize_message, serialize_message

from amb_core.ground.errors import AmbError
from amb_ident_node.readable import MessageReader
from amb_ident_node.recorded_topics import RECORDED, REGION_MESSAGES, RecordedTopic, monitor_progress
from amb_msgs.msg import AxisSamples, LoopSamples, Machine
from amb_ros.definitions import message_definition
from tests.fuzz.hostile import UNREADABLE

TOPICS = {topic.type: topic for topic in RECORDED}
TELEMETRY, MACHINE = TOPICS[LoopSamples], TOPICS[Machine]


@pytest.fixture(scope="module")
def reader() -> MessageReader:
    return MessageReader({topic.type_name: message_definition(topic.type_name) for topic in RECORDED})


def block(steps: int = 100, position_steps: int | None = None) -> LoopSamples:
    values = array("d", range(steps))
    position = values[:position_steps]
    axes = [AxisSamples(name=name, reference=values, position=position, current=values) for name in "xy"]
    return LoopSamples(run=1, sample_time=1e-4, axes=axes)


def published(message: Any) -> bytes:
    """As a publisher sends it: `serialize_message` of rclpy adds bytes of its memory to some messages."""
    data: bytes = serialize_message(message)
    return next(data[:end] for end in range(4, len(data) + 1) if _reads_as(data[:end], message))


def _reads_as(data: bytes, message: Any) -> bool:
    try:
        return bool(deserialize_message(data, type(message)) == message)
    except RuntimeError:
        return False


WHOLE = serialize_message(block())


def test_a_whole_message_is_read(reader: MessageReader) -> None:
    assert reader.read(TELEMETRY, WHOLE) == block()


@pytest.mark.parametrize(
    "data",
    [
        *UNREADABLE,
        WHOLE[:200],
        WHOLE[:-8],
        WHOLE + b"\1" * 40,
        WHOLE.replace(b"x\0", b"\xff\0", 1),  # no UTF-8
        WHOLE.replace(b"x\0", b"xx", 1),  # without its end
    ],
    ids=lambda data: f"{len(data)} bytes",  # what fills gaps in a message is another with each serialization
)
def test_bytes_that_a_reader_of_the_bag_does_not_understand_are_refused(reader: MessageReader, data: bytes) -> None:
    with pytest.raises(AmbError, match=f"the message cannot be read: its {len(data)} bytes are no LoopSamples"):
        reader.read(TELEMETRY, data)


@pytest.mark.parametrize(
    ("topic", "message", "reason"),
    [
        (TELEMETRY, block(0), "telemetry block of run 1 at step 0: it has no steps; allowed: 1 or more"),
        (TELEMETRY, block(9, 8), "its arrays must have the same length"),
        (TELEMETRY, LoopSamples(run=1, sample_time=1e-4), "allowed: at least one axis"),
        (MACHINE, Machine(name="rig"), "0 axes; allowed: 1 to"),
    ],
)
def test_a_message_that_would_spoil_its_topic_is_refused(
    reader: MessageReader, topic: RecordedTopic, message: Any, reason: str
) -> None:
    with pytest.raises(AmbError, match=reason):
        reader.read(topic, published(message))


def report(text: str) -> dict[str, str]:
    return {"run": "3", "next step": text, REGION_MESSAGES: "9"}


@pytest.mark.parametrize("text", ["", "-1", "1.0", "\u0663", "\u00b2", "9" * 20, str(2**64), "9" * 5_000, " 7", "None"])
def test_a_text_that_is_no_count_is_no_progress_of_a_monitor(text: str) -> None:
    assert monitor_progress(report(text)) is None


@pytest.mark.parametrize("count", [0, 100, 2**64 - 1])
def test_counts_are_the_progress_of_a_monitor(count: int) -> None:
    assert monitor_progress(report(str(count))) == (3, count, 9)
    assert monitor_progress({"run": "3"}) is None
