"""The recorder on slow and full disks: what it received is in the bag, or it reports what is not."""

from __future__ import annotations

import os
import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from amb_core.recording import Recording, audit_steps, inspect_bag, recover_bag
from amb_msgs.srv import StopRecording
from tests.graph.test_recorder import BLOCK, RECORDER, Loop
from tests.stalling_disk import StallingDisk

if TYPE_CHECKING:
    from tests.graph.conftest import Graph


class Health:
    """The last report of the recorder."""

    def __init__(self, graph: Graph) -> None:
        self.status = DiagnosticStatus()
        graph.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, 1000)

    def _on_report(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == "amb/recorder":
                self.status = status

    def number(self, key: str) -> int:
        return next((int(item.value) for item in self.status.values if item.key == key), 0)

    @property
    def received(self) -> int:
        """Messages that the recorder has received for the bag."""
        return sum(map(self.number, ("messages", "queued messages", "dropped messages")))


@pytest.fixture
def disk(graph: Graph) -> Iterator[StallingDisk]:
    """The disk of the processes of the graph."""
    disk = StallingDisk(graph.folder, graph.environment)
    yield disk
    disk.resume()  # a process that cannot write does not end


@pytest.fixture
def health(graph: Graph) -> Health:
    """What the recorder reports."""
    return Health(graph)


@pytest.fixture
def loop(graph: Graph, disk: StallingDisk) -> Loop:
    """Publishers in a graph with a disk that can stall."""
    return Loop(graph)


def publish_slowly(loop: Loop, health: Health, blocks: int) -> None:
    """Publish blocks of a run in portions, and wait for each: the queue of DDS must not overflow."""
    for first in range(0, blocks, 500):
        stop = min(first + 500, blocks)
        loop.publish_blocks(1, first, stop)
        loop.graph.wait_until(lambda stop=stop: health.received >= stop, f"{stop} blocks at the recorder")


def test_a_disk_that_stalls_loses_nothing(graph: Graph, disk: StallingDisk, health: Health, loop: Loop) -> None:
    """For longer than the queue of DDS, 2000 messages, can hold."""
    graph.start(RECORDER)
    assert loop.start_bag().success
    disk.stall()
    publish_slowly(loop, health, 2500)
    disk.resume()
    stopped = loop.stop_bag(1, 2500 * BLOCK)
    assert stopped.success, stopped.message
    assert Recording.read(stopped.uri).telemetry().steps == 2500 * BLOCK


def test_what_does_not_fit_is_counted_and_named_and_the_bag_stays_valid(
    graph: Graph, disk: StallingDisk, health: Health, loop: Loop
) -> None:
    graph.start(RECORDER, parameters={"queue_size": 1e6})  # 170 blocks, and the chunk in progress 200
    assert loop.start_bag().success
    disk.stall()
    publish_slowly(loop, health, 1000)
    assert health.number("dropped messages") >= 500
    assert health.number("dropped steps") >= 500 * BLOCK
    assert health.status.level == DiagnosticStatus.ERROR
    assert health.status.message.startswith("the disk is too slow, and the queue of 1 MB was full: dropped ")
    disk.resume()
    graph.wait_until(lambda: health.received >= 1000 and not health.number("queued messages"), "an empty queue")
    dropped = health.number("dropped steps")  # of this recording; after it, the diagnostics are of the next one
    loop.publish_blocks(1, 1000, 1100)
    stopped = loop.stop_bag(1, 1100 * BLOCK)
    assert not stopped.success

    bag = Recording.read(stopped.uri)
    assert not bag.truncated
    assert stopped.messages == bag.messages
    spans = bag.spans(1)  # with one gap, or with some where the disk still took a few messages
    assert len(spans) > 1 and (spans[0][0], spans[-1][1]) == (0, 1100 * BLOCK)
    missing = 1100 * BLOCK - sum(stop - start for start, stop in spans)
    assert missing == dropped
    assert f"{missing // BLOCK} messages of /amb/telemetry ({missing} steps)" in stopped.message
    first_gap = f"telemetry of run 1 lacks steps {spans[0][1]} to {spans[1][0] - 1}"
    assert re.search(rf"{first_gap}(?: \(|,| and )", stopped.message)


def test_a_stop_waits_for_the_disk(graph: Graph, disk: StallingDisk, health: Health, loop: Loop) -> None:
    graph.start(RECORDER)
    assert loop.start_bag().success
    disk.stall()
    publish_slowly(loop, health, 500)
    client = graph.node.create_client(StopRecording, "/amb/recorder/stop")
    graph.wait_until(client.service_is_ready, "the recorder")
    stopped = client.call_async(StopRecording.Request(wait_for_run=1, wait_for_step=500 * BLOCK))
    graph.wait_until(lambda: health.status.message.startswith("closing the bag"), "the end of the recording")
    disk.resume()
    graph.wait_until(stopped.done, "the answer")
    assert stopped.result().success, stopped.result().message
    assert Recording.read(stopped.result().uri).telemetry().steps == 500 * BLOCK


def test_a_disk_that_gets_full_ends_the_recording_with_a_whole_bag(graph: Graph, health: Health, loop: Loop) -> None:
    """And a new one starts when there is room."""
    room = int(400e6)  # B
    least = shutil.disk_usage(graph.folder).free - room
    graph.start(RECORDER, parameters={"minimum_free_space": float(least)})
    assert loop.start_bag().success
    publish_slowly(loop, health, 100)
    graph.wait_until(lambda: health.number("messages") >= 100, "the blocks in the bag")
    filler = graph.folder / "filler"
    with filler.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, 2 * room)
    graph.wait_until(lambda: "MB are free on its disk" in health.status.message, "the end of the recording")
    assert health.status.level == DiagnosticStatus.ERROR
    loop.publish_blocks(1, 100, 110)
    graph.wait_until(lambda: health.number("dropped messages") >= 10, "the loss")
    stopped = loop.stop_bag(1, 110 * BLOCK)
    assert not stopped.success
    assert "allowed: " in stopped.message
    assert "10 messages of /amb/telemetry (1000 steps)" in stopped.message
    bag = Recording.read(stopped.uri)
    assert not bag.truncated
    assert (bag.telemetry().steps, bag.messages) == (100 * BLOCK, stopped.messages)

    assert "MB are free on its disk" in loop.start_bag("too_early").message
    filler.unlink()
    assert loop.start_bag("next").success
    loop.publish_blocks(1, 110, 120)
    assert loop.stop_bag(1, 120 * BLOCK).success


def test_a_recorder_splits_its_bag_and_each_sample_is_in_it_once(graph: Graph, health: Health, loop: Loop) -> None:
    graph.start(RECORDER, parameters={"split_size": 10e3, "chunk_period": 0.05})
    assert loop.start_bag().success
    for first in range(0, 100, 10):
        loop.publish_blocks(1, first, first + 10)
        graph.wait_until(lambda stop=first + 10: health.number("messages") >= stop, "the blocks in the bag")
    stopped = loop.stop_bag(1, 100 * BLOCK)
    assert stopped.success, stopped.message
    assert len(list(Path(stopped.uri).glob("bag_*.mcap"))) > 2
    assert inspect_bag(stopped.uri).damage == []
    audit = audit_steps(stopped.uri, 1)
    assert (audit.first, audit.stop, audit.samples) == (0, 100 * BLOCK, 100 * BLOCK)
    assert (audit.lost(), audit.doubled, audit.out_of_order) == (0, 0, 0)


def test_the_bag_of_a_killed_recorder_is_recovered_up_to_its_last_chunk(
    graph: Graph, health: Health, loop: Loop
) -> None:
    process = graph.start(RECORDER, parameters={"chunk_period": 0.05})
    uri = Path(loop.start_bag().uri)
    file = uri / "bag_0.mcap"
    publish_slowly(loop, health, 20)
    graph.wait_until(lambda: inspect_bag(uri).runs and audit_steps(uri, 1).stop == 20 * BLOCK, "the blocks on the disk")
    graph.stop(process, signal.SIGKILL)
    before = file.read_bytes()
    state = inspect_bag(uri)
    assert state.damage[-1] == "metadata.yaml is missing or cannot be read"
    made = recover_bag(state, graph.folder / "recovered")
    assert inspect_bag(made).damage == []
    bag = Recording.read(made)
    assert not bag.truncated
    assert bag.telemetry().steps == 20 * BLOCK
    assert "/amb/recorder" in bag.parameters()
    assert file.read_bytes() == before
