"""The recorder: complete bags, complaints about incomplete ones, and bags that survive a kill."""

from __future__ import annotations

import contextlib
import resource
import signal
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from amb_bringup.cli import app
from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.experiment import SimulatorStand
from amb_core.ground.errors import BagError
from amb_core.recording import Recording
from amb_ident_node.recorded_topics import REGION_MESSAGES
from amb_msgs.msg import (
    AxisSamples,
    Excitation,
    ExcitationStatus,
    LoopSamples,
    RegionState,
    SimulatorState,
    StateSpaceModel,
)
from amb_msgs.srv import StartRecording, StopRecording
from amb_ros import interruptions
from amb_ros.qos import HISTORY, LATCHED
from tests.fuzz.hostile import DELIVERED
from tests.graph.limits import TIMEOUT

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

RECORDER = "amb_ident_node.recorder"
BLOCK = 100
SIGNALS = ("reference", "position", "current")


def block(run: int, first_step: int, samples: Callable[[int], np.ndarray]) -> LoopSamples:
    """A block of telemetry with the samples of the signals 0 to 5: reference, position, current of x, then of y."""
    axes = [
        AxisSamples(name=axis, **{name: array("d", samples(3 * k + n).tobytes()) for n, name in enumerate(SIGNALS)})
        for k, axis in enumerate("xy")
    ]
    return LoopSamples(run=run, first_step=first_step, sample_time=1e-4, axes=axes)


class Loop:
    """Publishes what simulator and controller would."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        node = graph.node
        self.telemetry = node.create_publisher(LoopSamples, "/amb/telemetry", HISTORY)
        self.state = node.create_publisher(SimulatorState, "/amb/simulator/state", LATCHED)
        self.excitation = node.create_publisher(Excitation, "/amb/excitation", LATCHED)
        self.status = node.create_publisher(ExcitationStatus, "/amb/excitation_status", LATCHED)
        self.model = node.create_publisher(StateSpaceModel, "/amb/model", LATCHED)
        self.diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish_blocks(self, run: int, first: int, stop: int) -> None:
        for number in range(first, stop):
            steps = np.arange(BLOCK * number, BLOCK * (number + 1))
            self.telemetry.publish(block(run, int(steps[0]), lambda k, steps=steps: np.sin(steps + k)))

    def start_bag(self, uri: str = "bag") -> Any:
        return self.graph.call(StartRecording, "/amb/recorder/start", uri=uri)

    def stop_bag(self, run: int = 0, step: int = 0, timeout: float = 0.0) -> Any:
        return self.graph.call(
            StopRecording, "/amb/recorder/stop", wait_for_run=run, wait_for_step=step, timeout=timeout
        )


@pytest.fixture
def loop(graph: Graph) -> Loop:
    """Publishers in a graph of their own, for tests that start a recorder themselves."""
    return Loop(graph)


def loop_with_a_recorder(graph: Graph) -> Loop:
    loop = Loop(graph)
    graph.start(RECORDER)
    return loop


@pytest.fixture
def recorded(share: Callable[..., Loop]) -> Loop:
    """A loop and a recorder, for tests that close the bags that they open."""
    return share(loop_with_a_recorder)


def test_everything_published_after_the_start_is_in_the_bag(loop: Loop, graph: Graph) -> None:
    controller = graph.add_node("pd_controller", "/amb")
    controller.declare_parameter("proportional_gain", 21_000.0)
    loop.state.publish(SimulatorState(mode=SimulatorState.PAUSED, run=3, step=0))
    loop.status.publish(ExcitationStatus(run=3, id=1, kind="square", accepted=True, first_step=200, steps=600))
    loop.model.publish(StateSpaceModel(order=1))
    graph.start(RECORDER)
    started = loop.start_bag()
    assert started.success, started.message
    loop.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name="amb/pd_controller")]))
    loop.publish_blocks(3, 0, 100)
    loop.state.publish(SimulatorState(mode=SimulatorState.PAUSED, run=3, step=100 * BLOCK))
    stopped = loop.stop_bag(3, 100 * BLOCK)
    assert stopped.success, stopped.message
    assert stopped.uri == started.uri == str(graph.folder / "bags" / "bag")

    bag = Recording.read(stopped.uri)
    assert not bag.truncated
    record = bag.telemetry(3)
    assert (record.first_step, record.steps) == (0, 100 * BLOCK)
    np.testing.assert_array_equal(record.position[:, 1], np.sin(np.arange(100 * BLOCK) + 4))
    assert [(item.first_step, item.stop) for item in bag.excitations()] == [(200, 800)]
    assert bag.experiment().steps == 600
    assert bag.parameters()["/amb/pd_controller"]["proportional_gain"] == 21_000.0
    assert bag.parameters()["/amb/recorder"]["chunk_period"] == 0.5
    assert bag.controller_parameters().proportional_gain == 21_000.0
    names = {topic.name for topic in bag.topics}
    assert {"/amb/telemetry", "/amb/simulator/state", "/amb/excitation_status", "/amb/model"} <= names
    assert {"/parameter_events", "/rosout", "/diagnostics"} <= names
    assert stopped.messages == bag.messages


def test_others_read_the_bag_with_its_definitions(recorded: Loop) -> None:
    recorded.start_bag("definitions")
    recorded.publish_blocks(1, 0, 5)
    folder = Path(recorded.stop_bag(1, 5 * BLOCK).uri)
    offered = recorded.graph.node.get_publishers_info_by_topic("/amb/telemetry")[0].topic_type_hash
    with AnyReader([folder]) as reader:
        (telemetry,) = (item for item in reader.connections if item.topic == "/amb/telemetry")
        assert telemetry.digest == str(offered)
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_a_start_loses_no_message(recorded: Loop) -> None:
    """Published in the very moment in which the recorder answers, again and again."""
    for run in range(1, 6):
        recorded.start_bag(f"bag_{run}")
        recorded.publish_blocks(run, 0, 20)
        stopped = recorded.stop_bag(run, 20 * BLOCK)
        assert stopped.success, stopped.message
        assert Recording.read(stopped.uri).telemetry(run).steps == 20 * BLOCK


def test_missing_telemetry_is_named_and_the_bag_closed(recorded: Loop) -> None:
    recorded.start_bag("missing")
    recorded.publish_blocks(1, 0, 3)
    recorded.publish_blocks(1, 5, 8)
    stopped = recorded.stop_bag(1, 8 * BLOCK)
    assert not stopped.success
    assert stopped.message == "telemetry of run 1 lacks steps 300 to 499 (200 steps)"
    assert not Recording.read(stopped.uri).truncated


def test_telemetry_that_does_not_come_is_missing(recorded: Loop) -> None:
    recorded.start_bag("late")
    recorded.publish_blocks(1, 0, 1)
    stopped = recorded.stop_bag(1, 5 * BLOCK, timeout=0.3)
    assert not stopped.success
    assert stopped.message == "telemetry of run 1 lacks steps 100 to 499 (400 steps)"


def test_the_end_of_an_experiment_says_what_its_bag_lacks(recorded: Loop) -> None:
    recorded.start_bag("of an experiment")
    recorded.publish_blocks(1, 0, 3)
    recorded.publish_blocks(1, 5, 8)
    with AmbClient(domain_id=recorded.graph.domain, timeout=TIMEOUT, nodes=()) as amb:
        stand = SimulatorStand(amb, lambda *_: None)
        with pytest.raises(
            ClientError, match=r"recorder/stop: telemetry of run 1 lacks steps 300 to 499 \(200 steps\)$"
        ):
            stand.close_recording(1, 8 * BLOCK)


def test_a_run_that_began_while_recording_must_be_there_from_its_first_step(recorded: Loop) -> None:
    recorded.start_bag("began")
    recorded.publish_blocks(1, 7, 9)
    recorded.publish_blocks(2, 1, 2)
    stopped = recorded.stop_bag(2, 2 * BLOCK)
    assert stopped.message == "telemetry of run 2 lacks steps 0 to 99 (100 steps)"


def test_what_cannot_be_read_is_reported_and_spoils_no_bag(recorded: Loop) -> None:
    recorded.start_bag("unreadable")
    recorded.publish_blocks(1, 0, 2)
    whole = serialize_message(block(1, 200, lambda k: np.zeros(BLOCK)))
    no_text = whole.replace(b"x\0", b"\xff\0", 1)
    for data in (*DELIVERED, whole[:300], whole + bytes(40), no_text):
        recorded.telemetry.publish(data)
        recorded.diagnostics.publish(DELIVERED[0])
    recorded.publish_blocks(1, 2, 4)
    stopped = recorded.stop_bag(1, 4 * BLOCK)
    assert not stopped.success
    refused = f"{len(DELIVERED) + 3} messages on telemetry were refused: the message cannot be read: its {len(no_text)}"
    assert refused in stopped.message
    assert "lacks" not in stopped.message
    bag = Recording.read(stopped.uri)
    assert bag.telemetry(1).steps == 4 * BLOCK
    assert len(list(bag.messages_of("/amb/telemetry"))) == 4
    assert list(bag.messages_of("/diagnostics"))
    assert bag.parameters()["/amb/recorder"]
    assert CliRunner().invoke(app, ["bag", "info", "--runs", stopped.uri], catch_exceptions=False).exit_code == 0


@pytest.mark.parametrize("text", ["9" * 5_000, str(2**64), "\u0663", "-1", ""], ids=len)
def test_no_text_of_diagnostics_ends_the_recorder(recorded: Loop, text: str) -> None:
    values = [KeyValue(key=key, value=text) for key in ("run", "next step", REGION_MESSAGES)]
    recorded.start_bag(f"text_{len(text)}_{text[:2]}")
    recorded.diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(name="amb/region_monitor", values=values)]))
    recorded.publish_blocks(1, 0, 1)
    stopped = recorded.stop_bag(1, BLOCK)
    assert stopped.success, stopped.message
    assert recorded.graph.process_of(RECORDER).poll() is None


@pytest.mark.parametrize("by", interruptions.SIGNALS)
def test_a_signal_closes_the_bag_and_the_exit_code_is_0(loop: Loop, graph: Graph, by: signal.Signals) -> None:
    process = graph.start(RECORDER)
    uri = loop.start_bag().uri
    loop.publish_blocks(1, 0, 10)
    file = next(Path(uri).glob("*.mcap"))
    size = file.stat().st_size
    graph.wait_until(lambda: file.stat().st_size > size, what="a chunk on the disk")
    code, errors = graph.stop(process, by)
    assert code == 0, errors
    bag = Recording.read(uri)
    assert not bag.truncated
    assert bag.telemetry().steps == 10 * BLOCK


def test_a_stop_does_not_wait_behind_another_that_waits_for_steps(loop: Loop, graph: Graph) -> None:
    """The newest says up to where, the most urgent how long; both get the answer about the one bag."""
    graph.start(RECORDER)
    uri = loop.start_bag().uri
    loop.publish_blocks(1, 0, 10)
    graph.wait_until(lambda: _steps_on_disk(uri) == 10 * BLOCK, what="the telemetry on the disk")
    client = graph.node.create_client(StopRecording, "/amb/recorder/stop")
    graph.wait_until(client.service_is_ready, "the recorder")
    # by one client: requests of two may arrive in either order
    first = client.call_async(StopRecording.Request(wait_for_run=1, wait_for_step=10**12, timeout=3600.0))
    second = client.call_async(StopRecording.Request(wait_for_run=1, wait_for_step=10 * BLOCK))
    graph.wait_until(second.done, "the answer to the second stop")
    stopped = second.result()
    assert stopped.success, stopped.message
    graph.wait_until(first.done, "the answer to the first stop")
    assert first.result() == stopped
    assert loop.stop_bag().message == "nothing is being recorded; call ~/start first"


def test_a_signal_ends_a_recorder_that_waits_for_steps(loop: Loop, graph: Graph) -> None:
    process = graph.start(RECORDER)
    uri = loop.start_bag().uri
    loop.publish_blocks(1, 0, 10)
    waiting = graph.node.create_client(StopRecording, "/amb/recorder/stop")
    graph.wait_until(waiting.service_is_ready, "the recorder")
    waiting.call_async(StopRecording.Request(wait_for_run=1, wait_for_step=10**9, timeout=3600.0))
    graph.wait_until(lambda: _steps_on_disk(uri) == 10 * BLOCK, what="the telemetry on the disk")
    code, errors = graph.stop(process)
    assert code == 0, errors
    assert not Recording.read(uri).truncated


def test_a_killed_recorder_leaves_all_but_the_last_chunk(loop: Loop, graph: Graph) -> None:
    process = graph.start(RECORDER, parameters={"chunk_period": 0.1})
    uri = loop.start_bag().uri
    loop.publish_blocks(1, 0, 50)
    graph.wait_until(lambda: _steps_on_disk(uri) == 50 * BLOCK, what="the telemetry on the disk")
    loop.publish_blocks(1, 50, 60)
    graph.stop(process, signal.SIGKILL)
    bag = Recording.read(uri)
    assert bag.truncated
    record = bag.telemetry()
    assert record.steps >= 50 * BLOCK
    np.testing.assert_array_equal(record.position[:, 0], np.sin(np.arange(record.steps) + 1))


def _bag_on_disk(uri: str) -> Recording | None:
    """The bag as far as it is written, None as long as nothing is."""
    with contextlib.suppress(BagError):
        return Recording.read(uri)
    return None


def _steps_on_disk(uri: str) -> int:
    bag = _bag_on_disk(uri)
    return bag.telemetry().steps if bag is not None and bag.runs else 0


def test_a_full_disk_ends_the_recording_but_not_the_node(loop: Loop, graph: Graph) -> None:
    limit = 2_000_000  # bytes a file may have: enough for what DDS keeps in shared memory, not for the bag
    process = graph.start(RECORDER, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    loop.start_bag()
    rng = np.random.default_rng(1)
    for number in range(40):
        noise = rng.normal(size=(6, 3000))  # always another, which cannot be compressed
        loop.telemetry.publish(block(1, 3000 * number, noise.__getitem__))
    stopped = loop.stop_bag(1, 3000 * 40)
    assert not stopped.success
    assert "cannot be written: File too large; not in the bag: " in stopped.message
    bag = Recording.read(stopped.uri)
    assert bag.truncated
    assert stopped.messages == bag.messages
    assert process.poll() is None
    assert not loop.stop_bag().success


def test_a_full_disk_is_refused_at_the_start(loop: Loop, graph: Graph) -> None:
    graph.start(RECORDER, parameters={"minimum_free_space": 1e15})
    started = loop.start_bag()
    assert not started.success
    assert "MB are free on its disk; allowed: 1e+09 MB or more" in started.message
    assert not (graph.folder / "bags").exists()


def test_a_disk_that_takes_nothing_is_refused_at_the_start(loop: Loop, graph: Graph) -> None:
    limit = 3000  # bytes a file may have: less than the definitions of the messages need
    graph.environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(_without_shared_memory(graph.folder))
    graph.start(RECORDER, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    started = loop.start_bag()
    assert not started.success
    assert "cannot be written: File too large" in started.message
    assert "nothing is being recorded" in loop.stop_bag().message
    assert not (graph.folder / "bags" / "bag").exists()


def _without_shared_memory(folder: Path) -> Path:
    """Settings under which DDS needs no file of its own."""
    profiles = folder / "udp_only.xml"
    profiles.write_text(
        """<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
        <transport_descriptors><transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type>
        </transport_descriptor></transport_descriptors>
        <participant profile_name="udp_only" is_default_profile="true"><rtps>
        <userTransports><transport_id>udp</transport_id></userTransports>
        <useBuiltinTransports>false</useBuiltinTransports></rtps></participant></profiles>"""
    )
    return profiles


def test_messages_that_their_publisher_counts_are_missed_by_number(recorded: Loop) -> None:
    publisher = recorded.graph.node.create_publisher(RegionState, "/amb/region", HISTORY)
    recorded.start_bag("counted")
    for sequence in (1, 2, 5, 6, 9):
        publisher.publish(RegionState(run=1, sequence=sequence, next_step=100 * sequence))
    recorded.publish_blocks(1, 0, 9)
    stopped = recorded.stop_bag(1, 9 * BLOCK)
    recorded.graph.node.destroy_publisher(publisher)
    assert not stopped.success
    assert stopped.message == "region lacks messages 3 to 4 and 7 to 8 (4 messages)"


def test_a_publisher_that_is_not_seen_any_more_still_counts(loop: Loop, graph: Graph) -> None:
    """As after the recorder was held up: it does not know the simulator's publishers, and has missed their messages."""
    graph.start(RECORDER)
    loop.state.publish(SimulatorState(run=5, mode=SimulatorState.RUNNING, sample_time=1e-4, sequence=1))
    assert loop.start_bag().success
    loop.publish_blocks(5, 0, 10)
    graph.node.destroy_publisher(loop.state)
    graph.wait_until(lambda: not graph.node.count_publishers("/amb/simulator/state"), "the end of the publisher")
    stopped = loop.stop_bag(5, 10 * BLOCK, timeout=2.0)
    assert not stopped.success
    assert "simulator/state lacks that of step 1000 of run 5" in stopped.message


def test_steps_that_come_twice_with_other_samples_are_named(recorded: Loop) -> None:
    recorded.start_bag("twice")
    recorded.publish_blocks(1, 0, 3)
    recorded.telemetry.publish(block(1, BLOCK, lambda _: np.ones(BLOCK)))
    recorded.publish_blocks(1, 3, 5)
    stopped = recorded.stop_bag(1, 5 * BLOCK)
    assert not stopped.success
    assert "steps 100 to 199 came twice with different samples" in stopped.message


def test_bad_requests_are_refused_and_the_node_lives(recorded: Loop) -> None:
    stopped = recorded.stop_bag()
    assert (stopped.success, stopped.message) == (False, "nothing is being recorded; call ~/start first")
    (recorded.graph.folder / "file").touch()
    assert "cannot be made: Not a directory" in recorded.start_bag(str(recorded.graph.folder / "file" / "bag")).message
    assert "cannot be made: File name too long" in recorded.start_bag("x" * 5000).message
    assert "exists already" in recorded.start_bag(str(recorded.graph.folder)).message
    assert recorded.start_bag("good").success
    again = recorded.start_bag("other")
    assert not again.success
    assert "already recording" in again.message
    assert "timeout = nan s is not allowed" in recorded.stop_bag(timeout=float("nan")).message
    assert recorded.stop_bag().success


def test_recording_on_start(loop: Loop, graph: Graph) -> None:
    process = graph.start(RECORDER, parameters={"record_on_start": True, "directory": "here"})
    graph.wait_until(lambda: list(graph.folder.glob("here/amb_*/*.mcap")), what="a bag")
    assert graph.stop(process)[0] == 0
    assert list(graph.folder.glob("here/amb_*/metadata.yaml"))


def test_a_wrong_parameter_ends_the_node_with_one_line(graph: Graph) -> None:
    process = graph.start(RECORDER, parameters={"chunk_period": 99.0})
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 1
    assert process.said.splitlines() == [
        "[amb] /amb/recorder: parameter 'chunk_period' = 99.0 is not allowed; allowed: 0.05 to 10 s"
    ]


def test_parameters_of_a_node_that_starts_after_the_bag_are_in_it(recorded: Loop) -> None:
    started = recorded.start_bag("late_node")
    late = recorded.graph.add_node("late", "/amb")
    late.declare_parameter("proportional_gain", 22_000.0)

    def gain() -> Any:
        bag = _bag_on_disk(started.uri)
        return bag.parameters().get("/amb/late", {}).get("proportional_gain") if bag else None

    recorded.graph.wait_until(gain, "the late parameters")
    assert gain() == 22_000.0
    assert recorded.stop_bag().success
