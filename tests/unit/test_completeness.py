"""Which messages a recording lacks, topic by topic."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import RepeatedSteps, StepCoverage
from amb_ident_node.completeness import AnswerAccount, Mark, PeriodicAccount, SequenceAccount, TelemetryAccount
from amb_ident_node.ledger import Ledger
from amb_msgs.msg import BridgeState, Excitation, ExcitationStatus, RegionState, SimulatorState
from amb_ros import topics
from amb_ros.namesakes import PATIENCE, Namesakes

TOPICS = {"telemetry", "plant_state", "region", "simulator/state", "clock"}


def block(run: int, first: int, steps: int) -> Any:
    samples = np.arange(first, first + steps, dtype=float)
    names = [f"{signal}_{axis}" for signal in ("reference", "position", "current") for axis in "xy"]
    return SimpleNamespace(run=run, first_step=first, sample_time=1e-4, **dict.fromkeys(names, samples))


def state(run: int, step: int, sequence: int, plant_state_steps: int = 50, mode: int = SimulatorState.PAUSED) -> Any:
    return SimpleNamespace(
        mode=mode,
        run=run,
        step=step,
        sequence=sequence,
        plant_state_steps=plant_state_steps,
        clock_steps=100,
        sample_time=1e-4,
    )


def clock(step: int) -> Any:
    return SimpleNamespace(clock=SimpleNamespace(sec=0, nanosec=100_000 * step))


def region(run: int, next_step: int, sequence: int, region: int = RegionState.A) -> Any:
    return SimpleNamespace(run=run, next_step=next_step, sequence=sequence, region=region)


@pytest.fixture
def ledger() -> Ledger:
    """Of a recording that begins at step 0 of run 5."""
    ledger = Ledger()
    ledger.note("simulator/state", state(5, 0, 1))
    ledger.start()
    ledger.begin(Mark(5, 0))
    return ledger


def fill(ledger: Ledger) -> None:
    """All that comes up to step 200, but for the topics that a test leaves out."""
    ledger.note("clock", clock(0))
    ledger.note("clock", clock(100))
    ledger.note("telemetry", block(5, 0, 100))
    ledger.note("telemetry", block(5, 100, 100))
    for step in range(0, 201, 50):
        ledger.note("plant_state", SimpleNamespace(run=5, step=step))
    ledger.note("region", region(5, 100, 1))
    ledger.note("region", region(5, 200, 2))
    ledger.note("simulator/state", state(5, 200, 2))


def test_a_message_that_was_dropped_is_missing_although_it_has_come() -> None:
    account = SequenceAccount("region")
    for sequence in (1, 2):
        account.note(sequence)
    for sequence in (4, 5):
        account.note_dropped(sequence)
    account.note(6)
    assert account.lacks() == ["region lacks messages 3 to 5 (3 messages)"]
    account.note_dropped(7)
    assert account.lacks() == ["region lacks messages 3 to 5 and 7 (4 messages)"]
    account.start()
    account.note(8)
    assert account.lacks() == []


def test_a_recording_that_holds_everything_lacks_nothing(ledger):
    fill(ledger)
    assert ledger.lacks(Mark(5, 200), TOPICS) == []


def test_each_topic_is_named_with_first_last_and_count_of_what_is_missing(ledger):
    ledger.note("clock", clock(0))
    ledger.note("telemetry", block(5, 0, 100))
    ledger.note("plant_state", SimpleNamespace(run=5, step=0))
    ledger.note("plant_state", SimpleNamespace(run=5, step=150))
    ledger.note("region", region(5, 100, 1))
    ledger.note("simulator/state", state(5, 200, 4))
    assert ledger.lacks(Mark(5, 200), TOPICS) == [
        "telemetry of run 5 lacks steps 100 to 199 (100 steps)",
        "plant_state of run 5 lacks steps 50 to 100 and 200 (3 messages)",
        "clock of run 5 lacks steps 100 (1 messages)",
        "simulator/state lacks messages 2 to 3 (2 messages)",
        "region of run 5 lacks steps 100 to 199 (100 steps)",
    ]


def test_what_is_under_way_beyond_the_awaited_step_is_not_missing(ledger):
    fill(ledger)
    ledger.note("telemetry", block(5, 200, 100))
    assert ledger.lacks(Mark(5, 200), TOPICS) == []


def test_topics_that_nobody_publishes_are_not_awaited(ledger):
    ledger.note("telemetry", block(5, 0, 200))
    assert ledger.lacks(Mark(5, 200), {"telemetry"}) == [
        "plant_state of run 5 lacks steps 50 to 150 (3 messages)",
        "clock of run 5 lacks steps 100 (1 messages)",
    ]
    quiet = Ledger()
    quiet.note("telemetry", block(5, 0, 200))
    assert quiet.lacks(Mark(5, 200), {"telemetry"}) == []


def test_what_was_counted_before_the_recording_shows_a_loss_at_its_beginning():
    ledger = Ledger()
    ledger.note("region", region(5, 100, 7))
    ledger.start()
    ledger.note("region", region(5, 300, 9))
    assert ledger.lacks() == ["region lacks messages 8 (1 messages)"]


def test_what_was_missing_before_the_recording_does_not_count():
    account = SequenceAccount("region")
    account.note(1)
    account.note(5)
    account.start()
    account.note(6)
    assert account.lacks() == []


def test_a_publisher_that_starts_again_counts_from_one():
    account = SequenceAccount("region")
    for sequence in (7, 1, 2):
        account.note(sequence)
    assert account.lacks() == []


def test_a_run_too_short_for_a_region_is_complete_once_the_monitor_has_taken_it_in(ledger):
    ledger.note("telemetry", block(5, 0, 5))
    assert "region of run 5 lacks steps 0 to 4 (5 steps)" in ledger.lacks(Mark(5, 5), TOPICS)
    ledger.note_monitor(5, 5, 0)
    assert not [text for text in ledger.lacks(Mark(5, 5), TOPICS) if text.startswith("region")]


def test_the_region_of_a_delevitation_is_awaited_although_another_reaches_as_far(ledger):
    """The monitor classifies the last telemetry, and only then hears that the rotor has fallen."""
    fill(ledger)
    ledger.note("simulator/state", state(5, 200, 3, mode=SimulatorState.DELEVITATED))
    ledger.note_monitor(5, 200, 2)
    assert ledger.lacks(Mark(5, 200), TOPICS) == ["region of run 5 lacks the delevitation before step 200"]
    assert ledger.lacks(Mark(5, 150), TOPICS) == []
    ledger.note("region", region(5, 200, 3, RegionState.D))
    assert ledger.lacks(Mark(5, 200), TOPICS) == []


def test_blocks_of_an_older_run_that_come_late_are_no_part_of_the_recording(ledger):
    fill(ledger)
    ledger.note("telemetry", block(4, 900, 100))
    assert ledger.lacks(Mark(5, 200), TOPICS) == []


@pytest.mark.parametrize("sample_time", [0.0, -1.0, float("nan"), 5e-324, float("inf")])
def test_a_clock_of_a_simulator_without_a_sample_time_is_left_out(sample_time):
    ledger = Ledger()
    impossible = state(5, 0, 1)
    impossible.sample_time = sample_time
    ledger.note("simulator/state", impossible)
    ledger.note("clock", clock(100))


def test_clocks_of_a_run_that_is_heard_of_later_belong_to_it(ledger):
    ledger.note("clock", clock(0))
    ledger.note("clock", clock(100))
    for step in (0, 100, 200):
        ledger.note("clock", clock(step))
    ledger.note("simulator/state", state(6, 0, 2, plant_state_steps=0))
    ledger.note("telemetry", block(6, 0, 400))
    assert ledger.lacks() == ["clock of run 6 lacks steps 300 (1 messages)"]


def test_messages_of_a_run_whose_state_comes_late_count():
    ledger = Ledger()
    ledger.note("simulator/state", state(4, 0, 1))
    ledger.note("clock", clock(0))
    ledger.start()
    ledger.learn(state(5, 0, 0))  # the recorder asks for it; the message is still on its way
    ledger.begin(Mark(5, 0))
    fill(ledger)
    ledger.note("simulator/state", state(6, 0, 3, mode=SimulatorState.RUNNING))
    assert ledger.lacks(Mark(5, 200), TOPICS) == []


def test_a_message_that_was_sent_before_the_recorder_asked_for_the_state_does_not_bring_the_old_one_back():
    ledger = Ledger()
    ledger.learn(state(5, 100, 0))
    ledger.note("simulator/state", state(4, 300, 1))
    assert (ledger.state.run, ledger.state.step) == (5, 100)
    ledger.note("simulator/state", state(5, 100, 2))
    ledger.note("simulator/state", state(3, 0, 1))  # another simulator: its message is the latest
    assert (ledger.state.run, ledger.state.step) == (3, 0)


def test_the_message_of_a_state_is_awaited_although_the_state_is_known(ledger):
    fill(ledger)
    ledger.note("telemetry", block(5, 200, 100))
    ledger.learn(state(5, 300, 0))
    assert "simulator/state lacks that of step 300 of run 5" in ledger.lacks(Mark(5, 300), {"simulator/state"})


def test_periodic_messages_count_although_their_period_is_known_later():
    account = PeriodicAccount("plant_state")
    for step in (0, 49, 50, 150):
        account.note(1, step)
    account.expect(1, 50)
    assert account.lacks(1, 0, 200) == ["plant_state of run 1 lacks steps 100 (1 messages)"]


def test_an_excitation_needs_an_answer():
    account = AnswerAccount()
    account.note_excitation(5, 1)
    account.start()
    account.note_answer(5, 3)  # overtakes its excitation
    account.note_excitation(5, 3)
    assert account.reached()
    account.note_excitation(5, 4)
    account.note_excitation(5, 5)
    assert not account.reached()
    assert account.lacks() == ["excitation_status lacks the answers to excitations 4 to 5 (2 messages)"]


@pytest.mark.parametrize("numbers", [(1_500_000_001, 1, 1_500_000_002), (1_500_000_001, 300_000_001), (1, 5, 1)])
def test_excitations_of_several_publishers_are_none_lost(ledger: Ledger, numbers: tuple[int, ...]) -> None:
    """Each generator begins anywhere, nodes of users as they like, and the last one played is published again."""
    for number in numbers:
        ledger.note("excitation", Excitation(run=1, id=number))
        ledger.note("excitation_status", ExcitationStatus(run=1, id=number))
    assert ledger.lacks(Mark(1, 0)) == []


def test_an_answer_needs_its_excitation() -> None:
    account = AnswerAccount()
    account.note_answer(5, 1)  # before the recording
    account.start()
    account.note_answer(5, 1)  # its end
    account.note_answer(5, 2)
    assert not account.reached()
    assert account.lacks() == ["excitation lacks excitations 2 (1 messages)"]
    assert account.reached(published=False)  # of a controller that plays signals of its own
    assert account.lacks(published=False) == []
    account.note_excitation(5, 2)  # overtaken by its answer
    assert account.reached()
    account.note_answer(6, 3)
    account.note_excitation(0, 3)  # meant for the current run
    assert account.reached()
    account.note_dropped(6, 4)
    account.note_answer(6, 4)
    assert account.lacks() == ["excitation lacks excitations 4 (1 messages)"]


def test_messages_at_other_steps_than_those_due_fill_no_gap():
    account = PeriodicAccount("plant_state")
    account.expect(1, 50)
    account.note(1, 49)
    assert account.lacks(1, 0, 100) == ["plant_state of run 1 lacks steps 0 to 50 (2 messages)"]


def record(first: int, steps: int, value: float = 0.0) -> LoopRecord:
    samples = np.full((steps, 2), value)
    return LoopRecord(first, 1e-4, samples, samples, samples)


def test_steps_that_come_twice_with_other_samples_are_a_conflict():
    repeated = RepeatedSteps()
    repeated.add(1, record(0, 100))
    repeated.add(1, record(100, 100))
    repeated.add(1, record(50, 100))
    assert repeated.conflict == ""
    repeated.add(1, record(150, 100, 1.0))
    assert repeated.conflict.startswith("telemetry of run 1: steps 150 to 249 came twice with different samples")


def test_a_conflict_ends_with_its_run_and_once_enough_blocks_agree():
    repeated = RepeatedSteps()
    for run in (1, 2):
        repeated.add(run, record(0, 100))
        repeated.add(run, record(0, 100, 1.0))
        assert f"run {run}" in repeated.conflict
    for number in range(1, 1 + repeated.COMPARED_BLOCKS):
        assert "run 2" in repeated.conflict
        repeated.add(2, record(100 * number, 100))
    repeated.add(2, record(50_000, 100))
    assert repeated.conflict == ""


def test_a_recording_keeps_the_conflict_of_an_earlier_run():
    account = TelemetryAccount()
    for value in (0.0, 1.0):
        account.note(1, record(0, 100, value))
    account.note(2, record(0, 100))
    assert "run 1: steps 0 to 99 came twice" in account.conflict


def test_two_instances_that_report_in_turn_are_two_nodes_and_a_restarted_one_is_not():
    namesakes = Namesakes()
    for instance in ("killed", "killed", "started again", "started again"):
        namesakes.note("amb/simulator", instance)
    assert not namesakes.lives_twice("amb/simulator")
    namesakes.note("amb/simulator", "killed")
    assert namesakes.lives_twice("amb/simulator")
    for _ in range(2 * PATIENCE - 1):
        assert namesakes.instances("amb/simulator") == ["started again", "killed"]
        namesakes.note("amb/simulator", "killed")
    assert not namesakes.lives_twice("amb/simulator")
    assert namesakes.instances("amb/simulator") == ["killed"]


def test_two_instances_are_two_although_one_reports_less_often():
    namesakes = Namesakes()
    for _ in range(3):
        for instance in ("swift", *["slow"] * (PATIENCE - 1)):
            namesakes.note("amb/recorder", instance)
    assert namesakes.lives_twice("amb/recorder")
    assert sorted(namesakes.instances("amb/recorder")) == ["slow", "swift"]


def test_of_three_instances_the_one_that_ends_is_forgotten():
    namesakes = Namesakes()
    for instance in ("ends", "first", "second") * 2 + ("first", "second") * 2 * PATIENCE:
        namesakes.note("amb/recorder", instance)
    assert namesakes.lives_twice("amb/recorder")
    assert sorted(namesakes.instances("amb/recorder")) == ["first", "second"]


def test_what_strangers_send_takes_bounded_memory(monkeypatch: pytest.MonkeyPatch):
    """Every message of another run, or with a gap before it: the accounts keep the latest, and count the rest."""
    monkeypatch.setattr("amb_ident_node.completeness.KEPT_RUNS", 10)
    monkeypatch.setattr("amb_ident_node.ledger.KEPT_RUNS", 10)
    monkeypatch.setattr(SequenceAccount, "KEPT", 10)
    monkeypatch.setattr(AnswerAccount, "KEPT", 10)
    monkeypatch.setattr(StepCoverage, "MOST_SPANS", 10)
    telemetry, periodic = TelemetryAccount(), PeriodicAccount("plant_state")
    answers, regions = AnswerAccount(), SequenceAccount("region")
    for run in range(1, 101):
        telemetry.note(run, record(0, 10))
        telemetry.note(1000, record(100 * run, 10))
        periodic.expect(run, 1)
        periodic.note(run, 0)
        answers.note_excitation(run, run)
        regions.note(2 * run)
    assert set(telemetry.runs) == {*range(92, 101), 1000}
    assert len(periodic._every) == len(periodic._seen) == 10
    assert answers.lacks() == ["excitation_status lacks the answers to excitations 91 to 100 (10 messages)"]
    assert "(99 messages)" in regions.lacks()[0]
    coverage = StepCoverage()
    for number in range(100):
        coverage.add(10 * number, 1)
    coverage.add(91, 1)
    assert len(coverage.spans) == 10
    assert coverage.spans[-1] == (90, 92)


def test_large_blocks_are_compared_with_fewer_others():
    repeated = RepeatedSteps()
    for number in range(20):
        repeated.add(1, record(10_000 * number, 10_000))
    assert len(repeated._blocks) == 10
    repeated.add(1, record(190_000, 10_000, 1.0))
    assert repeated.conflict


@pytest.mark.parametrize(
    ("mode", "within_run"),
    [
        (BridgeState.LEVITATED, True),
        (BridgeState.UNREACHABLE, True),
        (BridgeState.OFF, False),
        (BridgeState.TRIPPED, False),
    ],
)
def test_a_rig_at_rest_or_tripped_is_not_within_a_run(mode: int, within_run: bool) -> None:
    ledger = Ledger()
    assert ledger.within_run  # as long as nothing is known
    ledger.note(topics.BRIDGE_STATE, BridgeState(mode=mode, run=1))
    assert ledger.within_run is within_run
