"""A recording of the real graph holds what another listener has heard, or its end names what is missing."""

from __future__ import annotations

import itertools
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosgraph_msgs.msg import Clock

from amb_core.excitation import Sweep
from amb_core.recording import Recording
from amb_core.recording.messages.loop_samples import steps_in
from amb_msgs.msg import LoopSamples, PlantState, RegionState, SimulatorState
from amb_msgs.srv import StartRecording, StopRecording
from amb_ros.qos import EVERY_STATE, HISTORY, STREAM
from tests.graph.bearing import Bearing

if TYPE_CHECKING:
    from tests.graph.conftest import Graph

NODES = (
    "amb_sim_node.simulator",
    "amb_controller_node.pd_controller",
    "amb_controller_node.excitation_generator",
    "amb_ident_node.region_monitor",
    "amb_ident_node.recorder",
)
NUMBERS = itertools.count()
EVERY = 50  # steps between states of the plant


class Witness:
    """Hears what the recorder should, and waits for as much of it as the recorder does."""

    def __init__(self, graph: Graph) -> None:
        self.heard: dict[str, list[Any]] = {}
        for topic, kind, qos in (
            ("/amb/telemetry", LoopSamples, HISTORY),
            ("/amb/plant_state", PlantState, HISTORY),
            ("/amb/region", RegionState, HISTORY),
            ("/amb/simulator/state", SimulatorState, EVERY_STATE),
            ("/clock", Clock, STREAM),
        ):
            graph.node.create_subscription(kind, topic, self.heard.setdefault(topic, []).append, qos)

    def of(self, topic: str, run: int) -> list[Any]:
        return [message for message in self.heard[topic] if message.run == run]


def all_publishing_nodes(graph: Graph) -> Bearing:
    for module in NODES:
        graph.start(module, parameters={"plant_state_steps": EVERY} if module == NODES[0] else None)
    loop = Bearing(graph)
    loop.witness = Witness(graph)
    graph.wait_until(lambda: graph.node.count_publishers("/amb/region"), "the region monitor")
    return loop


@pytest.fixture
def recorded(share: Callable[..., Bearing]) -> Bearing:
    """A loop with all nodes that publish, and its witness."""
    return share(all_publishing_nodes, Bearing.resets)


def start_bag(loop: Bearing) -> str:
    answer = loop.graph.call(StartRecording, "/amb/recorder/start", uri=f"bag_{next(NUMBERS)}")
    assert answer.success, answer.message
    return answer.uri


def stop_bag(loop: Bearing, **fields: Any) -> Any:
    return loop.graph.call(StopRecording, "/amb/recorder/stop", **fields)


def messages(uri: str, topic: str) -> list[Any]:
    return list(Recording.read(uri).messages_of(topic))


def lacking(loop: Bearing, uri: str, run: int, steps: int) -> set[str]:
    """Topics of which the bag and the witness do not have the same messages of a run, in the same order, to its end."""
    witness: Witness = loop.witness
    graph = loop.graph
    graph.wait_until(lambda: any(item.next_step >= steps for item in witness.of("/amb/region", run)), "the region")
    regions = [(item.sequence, item.step, item.region) for item in messages(uri, "/amb/region")]
    states = [item.sequence for item in messages(uri, "/amb/simulator/state") if item.run == run]
    heard_states = [item.sequence for item in witness.of("/amb/simulator/state", run)]
    clocks = messages(uri, "/clock") if "/clock" in [topic.name for topic in Recording.read(uri).topics] else []
    times = [item.clock.sec + 1e-9 * item.clock.nanosec for item in clocks]
    whole = {
        "telemetry": sum(map(steps_in, messages(uri, "/amb/telemetry"))) == steps,
        "plant_state": [item.step for item in messages(uri, "/amb/plant_state")] == list(range(0, steps + 1, EVERY)),
        "region": regions == [(item.sequence, item.step, item.region) for item in witness.of("/amb/region", run)],
        "simulator/state": states == heard_states[-len(states) :] and states[-1] - states[0] + 1 == len(states),
        "clock": {round(1e4 * time) for time in times} >= set(range(0, steps, 100)) - {0},
    }
    return {topic for topic, is_whole in whole.items() if not is_whole}


def assert_holds_what_was_heard(loop: Bearing, uri: str, run: int, steps: int) -> None:
    assert lacking(loop, uri, run, steps) == set()


def test_a_run_is_whole_without_a_word_about_its_end(recorded: Bearing) -> None:
    """Stopped at once after the last step, whose block of telemetry is not full yet."""
    for _ in range(3):
        run = recorded.reset()
        uri = start_bag(recorded)
        recorded.run(475)
        recorded.wait_for_step(run, 475)
        stopped = stop_bag(recorded)
        assert stopped.success, stopped.message
        assert_holds_what_was_heard(recorded, uri, run, 475)


def test_the_region_that_reports_the_delevitation_is_in_the_bag(recorded: Bearing) -> None:
    run = recorded.reset()
    uri = start_bag(recorded)
    recorded.excite(Sweep(amplitude=100e-6, duration=1.0, frequency_start=20.0, frequency_end=200.0), run, 100)
    recorded.run(0)
    end = recorded.wait_for_mode(SimulatorState.DELEVITATED)
    stopped = stop_bag(recorded)
    assert stopped.success, stopped.message
    assert messages(uri, "/amb/region")[-1].region == RegionState.D
    assert_holds_what_was_heard(recorded, uri, run, end.step)


def test_a_recorder_that_was_held_up_still_gets_everything_or_names_it(recorded: Bearing) -> None:
    run = recorded.reset()
    uri = start_bag(recorded)
    process = recorded.graph.process_of("amb_ident_node.recorder")
    process.send_signal(signal.SIGSTOP)
    recorded.run(20_000)
    recorded.wait_for_step(run, 20_000)
    process.send_signal(signal.SIGCONT)
    stopped = stop_bag(recorded, wait_for_run=run, wait_for_step=20_000, timeout=30.0)
    # On a busy machine the steps take longer than the 20 s after which DDS gives a silent participant up. What has no
    # history is then lost.
    named = {part.split()[0] for part in stopped.message.split("; ")} if not stopped.success else set()
    assert lacking(recorded, uri, run, 20_000) == named, stopped.message


@pytest.mark.slow
def test_a_recorder_that_the_others_gave_up_names_what_it_lost(recorded: Bearing) -> None:
    """DDS gives up a participant that is silent for 20 s; found again, it does not see the publishers for a while.

    The recorder alone subscribes to /rosout.
    """
    graph = recorded.graph
    run = recorded.reset()
    uri = start_bag(recorded)
    process = graph.process_of("amb_ident_node.recorder")
    process.send_signal(signal.SIGSTOP)
    recorded.run(20_000)
    recorded.wait_for_step(run, 20_000)
    graph.wait_until(lambda: not graph.node.count_subscribers("/rosout"), "the end of the recorder's lease")
    process.send_signal(signal.SIGCONT)
    stopped = stop_bag(recorded, wait_for_run=run, wait_for_step=20_000, timeout=30.0)
    named = {part.split()[0] for part in stopped.message.split("; ")} if not stopped.success else set()
    assert lacking(recorded, uri, run, 20_000) == named, stopped.message


def test_nothing_of_older_runs_is_in_a_bag_but_the_latched_messages(recorded: Bearing) -> None:
    for _ in range(2):
        run = recorded.reset()
        recorded.run(3000)
        recorded.wait_for_step(run, 3000)
    recorded.graph.stop(recorded.graph.process_of("amb_ident_node.recorder"))
    recorded.graph.start("amb_ident_node.recorder")  # gets all that the publishers keep, when discovery brings it
    run = recorded.reset()
    uri = start_bag(recorded)
    recorded.run(500)
    recorded.wait_for_step(run, 500)
    stopped = stop_bag(recorded, wait_for_step=500)  # of the current run
    assert stopped.success, stopped.message
    for topic in ("/amb/telemetry", "/amb/plant_state", "/amb/region"):
        assert {item.run for item in messages(uri, topic)} == {run}, topic
    assert [item.step for item in messages(uri, "/amb/plant_state")] == list(range(0, 501, EVERY))


def test_a_recording_in_the_middle_of_a_run_is_whole_from_its_start(recorded: Bearing) -> None:
    run = recorded.reset()
    recorded.run(0)
    recorded.wait_for_step(run, 500)
    uri = start_bag(recorded)
    began = recorded.states[-1].step
    recorded.wait_for_step(run, began + 3000)
    stopped = stop_bag(recorded)
    assert stopped.success, stopped.message
    record = Recording.read(uri).telemetry(run)
    assert record.steps == record.position.shape[0] > 0
    states = [item.step for item in messages(uri, "/amb/plant_state")]
    assert states == list(range(states[0], states[-1] + 1, EVERY))
    assert record.first_step <= states[0] <= record.first_step + 100 + EVERY
    recorded.reset()


def test_bags_carry_the_quality_of_service_that_is_offered(recorded: Bearing) -> None:
    recorded.reset()
    uri = start_bag(recorded)
    assert stop_bag(recorded).success
    described = yaml.safe_load((Path(uri) / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    offered = {
        item["topic_metadata"]["name"]: item["topic_metadata"]["offered_qos_profiles"]
        for item in described["topics_with_message_count"]
    }
    for topic in ("telemetry", "plant_state", "excitation", "excitation_status", "region", "simulator/state", "model"):
        assert {profile["durability"] for profile in offered[f"/amb/{topic}"]} == {"transient_local"}, topic
    assert {profile["durability"] for profile in offered["/clock"]} == {"volatile"}
    assert {profile["reliability"] for profiles in offered.values() for profile in profiles} == {"reliable"}


def test_a_bag_holds_the_diagnostics_of_its_graph_only(recorded: Bearing) -> None:
    stranger = recorded.graph.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    recorded.graph.wait_until(lambda: stranger.get_subscription_count() > len(NODES), "the recorder")
    uri = start_bag(recorded)
    stranger.publish(DiagnosticArray(status=[DiagnosticStatus(name="other_rig/pump")]))
    run = recorded.reset()
    recorded.run(3000)
    recorded.wait_for_step(run, 3000)
    assert stop_bag(recorded).success
    names = {status.name for item in messages(uri, "/diagnostics") for status in item.status}
    assert names
    assert all(name.startswith("amb/") for name in names)


def wait_for_errors(loop: Bearing, text: str, nodes: set[str]) -> None:
    """Wait until these nodes report an error with this text, from now on."""
    loop.diagnostics.clear()

    def reporting() -> set[str]:
        statuses = [status for status in list(loop.diagnostics) if text in status.message]
        return {status.name for status in statuses if status.level == DiagnosticStatus.ERROR}

    loop.graph.wait_until(lambda: reporting() >= nodes, f"'{text}' from {nodes}")


@pytest.mark.parametrize("name", ["pd_controller", "another_controller"])
def test_two_controllers_are_an_error_of_all_concerned_and_named_at_the_end(recorded: Bearing, name: str) -> None:
    run = recorded.reset()
    start_bag(recorded)
    gain = {"derivative_gain": 40.0}
    rival = recorded.graph.start("amb_controller_node.pd_controller", "-r", f"__node:={name}", parameters=gain)
    names = ", ".join(sorted(["/amb/pd_controller", f"/amb/{name}"]))
    text = f"2 nodes publish /amb/telemetry: {names}"
    wait_for_errors(recorded, text, {"amb/pd_controller", f"amb/{name}", "amb/region_monitor", "amb/recorder"})
    recorded.run(1000)
    recorded.wait_for_step(run, 1000)
    stopped = stop_bag(recorded)
    assert not stopped.success
    assert text in stopped.message
    recorded.graph.stop(rival)


def test_two_simulators_are_an_error_of_all_concerned_and_named_at_the_end(recorded: Bearing) -> None:
    recorded.reset()
    start_bag(recorded)
    rival = recorded.graph.start("amb_sim_node.simulator")
    text = "2 nodes publish /amb/simulator/state: /amb/simulator, /amb/simulator"
    wait_for_errors(recorded, text, {"amb/simulator", "amb/region_monitor", "amb/recorder"})
    stopped = stop_bag(recorded, timeout=0.2)
    assert not stopped.success
    assert text in stopped.message
    recorded.graph.stop(rival)


def test_two_recorders_are_an_error_of_both_and_neither_claims_that_nothing_is_recorded(recorded: Bearing) -> None:
    run = recorded.reset()
    start_bag(recorded)
    recorded.diagnostics.clear()  # reports of an earlier rival
    first = recorded.graph.process_of("amb_ident_node.recorder")
    rival = recorded.graph.start("amb_ident_node.recorder")
    text = "2 nodes are named /amb/recorder: process"

    def both_report() -> bool:
        statuses = [status for status in recorded.diagnostics if text in status.message]
        processes = {item.value.split()[1] for status in statuses for item in status.values if item.key == "instance"}
        return processes == {str(first.pid), str(rival.pid)}

    recorded.graph.wait_until(both_report, "an error of both recorders")
    for process in (first, rival):
        recorded.graph.wait_until(lambda process=process: text in process.said, "the error in the log of both")
    recorded.run(100)
    recorded.wait_for_step(run, 100)
    stopped = stop_bag(recorded)  # answered by either
    assert not stopped.success
    assert text in stopped.message
    assert "nothing is being recorded" not in stopped.message
    recorded.graph.stop(rival)
    recorded.diagnostics.clear()

    def is_over() -> bool:
        return any(
            status.name == "amb/recorder" and status.level == DiagnosticStatus.OK and text in item.value
            for status in recorded.diagnostics
            for item in status.values
            if item.key == "last alarm"  # beside that of an earlier rival, if it was not over when this one came
        )

    recorded.graph.wait_until(is_over, "the end of the error, and when it was")


def test_a_simulator_that_is_killed_within_a_run_is_named_at_the_end(recorded: Bearing) -> None:
    run = recorded.reset()
    start_bag(recorded)
    recorded.run(0)
    recorded.graph.wait_until(lambda: any(block.run == run for block in recorded.blocks), "telemetry")
    recorded.graph.stop(recorded.graph.process_of("amb_sim_node.simulator"), by=signal.SIGKILL)
    stopped = stop_bag(recorded)
    assert not stopped.success
    assert "/amb/simulator died or hangs, last seen at 20" in stopped.message
    last = max(block.first_step + steps_in(block) for block in recorded.blocks if block.run == run) - 1
    assert f"telemetry ends at step {last} of run {run}" in stopped.message
