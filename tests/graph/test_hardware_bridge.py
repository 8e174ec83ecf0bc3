"""The hardware bridge with an emulated target: life cycle, samples, excitations, trips, losses and restarts."""

from __future__ import annotations

import itertools
import random
import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from amb_bringup.client import AmbClient, ClientError
from amb_bringup.client.experiment import RigStand, landing
from amb_bringup.demos.demo_run import controller_of, plant_of
from amb_bringup.graph.packages import find_executable
from amb_core.excitation import Square, generate
from amb_core.loop.control import PdController
from amb_core.plant.simulation import simulate
from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_msgs.msg import BridgeState, Excitation, ExcitationStatus, Machine, Trip
from amb_ros.alarms import HOLD
from amb_ros.qos import EVERY_STATE, LATCHED
from amb_sim_node.hardware_bridge import SETTINGS_WAIT
from tests.graph.conftest import Graph
from tests.graph.limits import TIMEOUT
from tests.graph.rig import EMULATOR, UNHURRIED, Rig, config, free_port, unhurried_file

GENERATOR = "amb_controller_node.excitation_generator"
SQUARE = Square(amplitude=10e-6, duration=0.2, frequency=20.0, axes="in_turn")
WRONG = {
    "unconfigured": ("activate", "deactivate", "cleanup", "nonsense"),
    "inactive": ("configure", "deactivate", "nonsense"),
    "active": ("configure", "activate", "cleanup", "nonsense"),
}


def refuse_wrong_transitions(rig: Rig, state: str, count: int) -> None:
    """Ask for transitions that a state does not allow, by label and by number."""
    draw = random.Random(state)
    assert rig.life_cycle == state
    for _ in range(count):
        if draw.random() < 0.7:
            label = draw.choice(WRONG[state])
            assert not rig.change(label)
            reason = f"{label} is not allowed while {state}; allowed: "
            rig.graph.wait_until(lambda reason=reason: reason in rig.state.problem, "the reason")
        else:
            assert not rig.change(number=draw.choice([9, 77, 255]))
    assert rig.life_cycle == state
    assert rig.bridge.poll() is None


def test_wrong_transitions_are_refused_and_right_ones_lead_through_the_life_cycle(graph: Graph) -> None:
    rig = Rig(graph)
    refuse_wrong_transitions(rig, "unconfigured", 12)
    assert rig.change("configure")
    refuse_wrong_transitions(rig, "inactive", 11)
    assert rig.change("activate")
    assert rig.state.mode == BridgeState.LEVITATED
    refuse_wrong_transitions(rig, "active", 11)
    assert rig.change("deactivate")
    assert rig.state.mode == BridgeState.OFF
    assert rig.change("cleanup")
    assert rig.change("configure")
    assert rig.change("shutdown")
    assert rig.life_cycle == "finalized"
    assert not rig.change("configure")


def test_a_levitation_is_called_off_by_a_landing_and_by_the_end_of_the_bridge(graph: Graph) -> None:
    rig = Rig(graph, bridge={"levitation_time": 60.0})
    for label in ("deactivate", "shutdown"):
        assert rig.change("configure")
        levitated = rig.asked("activate")
        graph.wait_until(lambda: rig.state.mode == BridgeState.LEVITATING, "the levitation")
        rig.states.clear()
        assert rig.change(label)
        assert not levitated()
        graph.wait_until(lambda: BridgeState.OFF in [state.mode for state in rig.states], "the landing")
        assert rig.change("cleanup") == (label == "deactivate")


def test_a_bridge_that_cannot_land_its_rotor_is_not_shut_down_and_says_why(graph: Graph) -> None:
    rig = Rig(graph, bridge={"link.timeout": 8.0, "link.silence": 60.0})
    rig.levitate()
    graph.stop(rig.emulator, signal.SIGKILL)
    assert not rig.change("shutdown")
    assert rig.state.problem.startswith("deactivate: ")
    # Without its process the emulated target lives for some milliseconds: if it lands in them, the bridge tries again.
    graph.wait_until(lambda: rig.life_cycle == "active", "the end of all transitions")


@pytest.mark.parametrize("by", ["land", "a session that is interrupted"])
def test_a_client_lands_a_rotor_that_is_being_levitated(graph: Graph, by: str) -> None:
    rig = Rig(graph, bridge={"levitation_time": 60.0})
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as amb:
        amb.rig.connect()
        levitated = rig.asked("activate")
        graph.wait_until(lambda: rig.state.mode == BridgeState.LEVITATING, "the levitation")
        if by == "land":
            amb.rig.land()
        else:
            with pytest.raises(KeyboardInterrupt), landing(RigStand(amb, lambda *_: None), recorded=False):
                raise KeyboardInterrupt
        assert not levitated()
        assert rig.life_cycle == "inactive"
        graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the end of the currents")
        with pytest.raises(ClientError, match="deactivate is not allowed while inactive; allowed: "):
            amb.rig.land()


@pytest.mark.parametrize("levitated", [True, False])
def test_off_switches_the_currents_off_at_once(graph: Graph, levitated: bool) -> None:
    rig = Rig(graph, bridge={"levitation_time": 0.0 if levitated else 60.0, "landing_time": 60.0})
    assert rig.change("configure")
    answer = rig.asked("activate")
    mode = BridgeState.LEVITATED if levitated else BridgeState.LEVITATING
    graph.wait_until(lambda: rig.state.mode == mode, "the rotor")
    if levitated:
        assert answer()
    assert graph.call(Trigger, "/amb/hardware_bridge/off").success
    assert levitated or not answer()
    graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the end of the currents")
    graph.wait_until(lambda: rig.life_cycle == "inactive", "the end of the levitation")


def test_off_reaches_a_target_that_the_bridge_has_not_connected_to(graph: Graph) -> None:
    """As after a killed bridge, which leaves the rotor levitated: the next one starts unconfigured."""
    rig = Rig(graph)
    rig.levitate()
    rig.bridge.kill()
    rig.bridge.wait()
    rig.start_bridge()
    assert rig.life_cycle == "unconfigured"
    assert graph.call(Trigger, "/amb/hardware_bridge/off").success
    assert rig.change("configure")
    assert rig.state.mode == BridgeState.OFF


def test_off_says_that_no_target_answers(graph: Graph) -> None:
    Rig(graph, bridge={"link.port": free_port(), "link.timeout": 0.2})
    answer = graph.call(Trigger, "/amb/hardware_bridge/off")
    assert not answer.success
    assert "press the emergency stop" in answer.message, answer.message


@pytest.mark.parametrize("by", ["off", "deactivate"])
def test_a_levitation_that_is_called_off_is_no_error(graph: Graph, by: str) -> None:
    rig = Rig(graph, bridge={"levitation_time": 60.0})
    assert rig.change("configure")
    levitated = rig.asked("activate")
    graph.wait_until(lambda: rig.state.mode == BridgeState.LEVITATING, "the levitation")
    rig.statuses.clear()
    if by == "off":
        assert graph.call(Trigger, "/amb/hardware_bridge/off").success
    else:
        assert rig.change("deactivate")
    assert not levitated()
    graph.wait_until(lambda: rig.life_cycle == "inactive" and rig.state.mode == BridgeState.OFF, "the end")
    count = len(rig.health("hardware_bridge"))
    graph.wait_until(lambda: len(rig.health("hardware_bridge")) > count + 1, "diagnostics")
    assert DiagnosticStatus.ERROR not in [status.level for status in rig.health("hardware_bridge")]


def test_a_transition_that_failed_is_an_error_for_a_while(graph: Graph) -> None:
    rig = Rig(graph, bridge={"link.port": free_port(), "link.timeout": 0.2})
    assert not rig.change("configure")
    graph.wait_until(
        lambda: any(status.message.startswith("configure: ") for status in rig.health("hardware_bridge")), "the error"
    )
    graph.wait_until(lambda: rig.health("hardware_bridge")[-1].level == DiagnosticStatus.OK, "its end")
    assert rig.values("hardware_bridge")["last alarm"].startswith("configure: ")
    assert rig.state.problem.startswith("configure: ")


def test_a_bridge_that_cannot_take_a_levitated_rotor_over_shows_that_as_long_as_the_rotor_is_up(graph: Graph) -> None:
    rig = Rig(graph, bridge={"at_exit": "stay"})
    rig.levitate()
    graph.stop(rig.bridge)
    graph.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
    graph.environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
    rig.start_bridge()
    assert rig.change("configure")
    assert not rig.change("activate")
    rig.statuses.clear()

    def levels() -> list[bytes]:
        return [status.level for status in rig.health("hardware_bridge")]

    graph.wait_until(lambda: DiagnosticStatus.ERROR in levels(), "the failure on /diagnostics")  # others came before it
    first = levels().index(DiagnosticStatus.ERROR)
    longer = round(HOLD / 0.5) + 4  # reports than a single event is shown in
    graph.wait_until(lambda: len(levels()) > first + longer, "diagnostics")
    shown = [(status.level, status.message) for status in rig.health("hardware_bridge")[first:]]
    reason = "activate: other hosts of the network reach this node"
    assert all(level == DiagnosticStatus.ERROR and reason in message for level, message in shown), shown


@pytest.mark.parametrize("machine", ["paper", "rig"])
def test_its_telemetry_is_that_of_the_loop_without_ros_bit_for_bit(graph: Graph, machine: str) -> None:
    file = config(machine)
    rig = Rig(graph, "--params-file", str(file))
    graph.start(GENERATOR)
    machines: list[Machine] = []
    graph.node.create_subscription(Machine, "/amb/machine", machines.append, LATCHED)
    run = rig.levitate()
    answer = rig.excite(SQUARE)
    assert answer.success, answer.message
    steps = answer.first_step + answer.steps + 500
    record = rig.record(run, steps)
    plant, controller = plant_of(file), controller_of(file)
    samples = generate(SQUARE, plant.machine.sample_rate, plant.machine).samples
    law = PdController(controller, len(plant.machine.axes))
    assert record.identical_to(simulate(plant, law, steps, samples, answer.first_step))
    assert machines[-1].source == "bridge"
    assert [axis.name for axis in machines[-1].axes] == list(record.axes)
    assert rig.state.lost == 0


def test_an_excitation_begins_at_the_step_that_was_asked_for_and_a_later_one_replaces_it(graph: Graph) -> None:
    rig = Rig(graph)
    graph.start(GENERATOR)
    run = rig.levitate()
    before = rig.excite(SQUARE)
    assert before.success, before.message
    rig.wait_for_step(before.first_step + 300)
    first = int(rig.state.step) + 20_000
    answer = rig.excite(SQUARE, first)
    assert (answer.success, answer.first_step, answer.steps) == (True, first, 2_000), answer.message
    late = rig.excite(SQUARE, 5)
    assert not late.success
    assert "first_step = 5 is in the past" in late.message
    record = rig.record(run, first + 300)
    moved = np.flatnonzero(record.reference.any(axis=1))
    assert moved[0] == before.first_step
    assert moved[moved > before.first_step + 2_000 + 1_000][0] == first  # the fade of the one before is short
    second = rig.excite(SQUARE)
    assert second.success, second.message
    assert second.first_step > first


def test_an_excitation_that_a_landing_cuts_short_is_reported_as_ended(graph: Graph) -> None:
    rig = Rig(graph)
    graph.start(GENERATOR)
    answers: list[ExcitationStatus] = []
    graph.node.create_subscription(ExcitationStatus, "/amb/excitation_status", answers.append, EVERY_STATE)
    rig.levitate()
    whole = rig.excite(SQUARE)
    assert whole.success, whole.message
    rig.wait_for_step(whole.first_step + whole.steps + 100)
    cut = rig.excite(Square(amplitude=10e-6, duration=20.0))
    assert cut.success, cut.message
    rig.wait_for_step(cut.first_step + 500)
    assert rig.change("deactivate")
    graph.wait_until(lambda: answers[-1].kind == "stop", "the end")
    assert [answer.kind for answer in answers] == ["square", "square", "stop"]
    end = answers[-1]
    assert (end.id, end.accepted) == (answers[1].id, True)
    assert cut.first_step + 500 <= end.first_step < cut.first_step + cut.steps


def test_what_protection_forbids_is_refused_in_one_line_and_the_loop_goes_on(graph: Graph) -> None:
    rig = Rig(graph, bridge={"protection.excitation_amplitude": 20e-6, "protection.longest_excitation": 1.0})
    graph.start(GENERATOR)
    refused = graph.call(
        _start(), "/amb/excitation_generator/start", kind="square", run=1, amplitude=1e-6, duration=1.0
    )
    assert not refused.success
    run = rig.levitate()
    for excitation, reason in (
        (Square(amplitude=30e-6, duration=0.1), "amplitude of 30 um on x; allowed on this rig: 20 um"),
        (Square(amplitude=10e-6, duration=2.0), "2 s long; allowed on this rig: 1 s"),
    ):
        answer = rig.excite(excitation)
        assert not answer.success
        assert reason in answer.message
    (reason,) = rig.refusals("hardware_bridge", protection__alarm_share=0.6)
    assert "alarm_share = 0.6 is above trip_share = 0.5; allowed" in reason
    assert rig.state.problem == ""
    assert not rig.record(run, 2_000).reference.any()
    assert rig.trips == []


def test_a_stranger_neither_weakens_protection_nor_takes_the_rotor_out_of_its_control(graph: Graph) -> None:
    rig = Rig(graph, bridge={"allowed.derivative_gain": [30.0, 45.0]})
    graph.start(GENERATOR)
    run = rig.levitate()
    for change, reason in (
        ({"protection__trip_share": 1.0}, "'protection.trip_share' = 1 protects less; allowed: up to 0.5"),
        ({"protection__alarm_share": 0.5}, "'protection.alarm_share' = 0.5 protects less; allowed: up to 0.4"),
        ({"proportional_gain": 0.0}, "'proportional_gain' = 0 is not allowed on a rig; allowed: as at the start"),
        ({"proportional_gains": [0.0, 0.0]}, "'proportional_gain' = 0, 0 is not allowed on a rig"),
        ({"derivative_gain": 0.0}, "'derivative_gain' = 0 is not allowed on a rig; allowed: 30 to 45"),
        ({"nominal_reference": [2e-4, 0.0]}, "'nominal_reference' = 0.0002, 0 is not allowed on a rig"),
        ({"current_limit": 0.0}, "'current_limit' = 0 is not allowed on a rig"),
    ):
        (refusal,) = rig.refusals("hardware_bridge", **change)
        assert reason in refusal
    rig.set("hardware_bridge", derivative_gain=40.0, protection__alarm_share=0.3)
    (refusal,) = rig.refusals("hardware_bridge", protection__alarm_share=0.4)
    assert "allowed: up to 0.3, as now, while the rig is on" in refusal
    answer = rig.excite(Square(amplitude=100e-6, duration=0.1))
    assert not answer.success
    rig.wait_for_step(2_000)
    assert rig.trips == []
    assert rig.state.run == run
    assert rig.state.mode == rig.state.LEVITATED
    rig.reset_faults()  # of a rig without faults; changes nothing
    assert rig.change("deactivate")
    (refusal,) = rig.refusals("hardware_bridge", proportional_gain=0.0)  # off, too: a stranger could levitate it then
    assert "not allowed on a rig" in refusal
    rig.set("hardware_bridge", protection__alarm_share=0.4)


def test_a_bridge_that_other_hosts_reach_levitates_only_if_its_operator_allows_that(graph: Graph) -> None:
    graph.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
    graph.environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
    rig = Rig(graph)
    assert rig.change("configure")
    assert not rig.change("activate")
    graph.wait_until(lambda: "other hosts of the network reach this node" in rig.state.problem, "the reason")
    assert "network: allow" in rig.state.problem
    graph.stop(rig.bridge)
    rig._bridge["network"] = "allow"
    rig.start_bridge()
    rig.levitate()


def _start():
    from amb_msgs.srv import StartExcitation

    return StartExcitation


FAULTS = {
    "sensor stuck": ({"faults__sensor__stuck": "y"}, {"faults__sensor__stuck": ""}, Trip.SENSOR_STUCK, "y"),
    "sensor out of range": ({"faults__sensor__failed": "x"}, {"faults__sensor__failed": ""}, Trip.SENSOR_RANGE, "x"),
    "amplifier": ({"faults__amplifier": True}, {"faults__amplifier": False}, Trip.AMPLIFIER, ""),
    "temperature": ({"faults__temperature": 300.0}, {"faults__temperature": 20.0}, Trip.TEMPERATURE, ""),
}


def test_every_trip_is_latched_dated_and_comes_with_the_second_before_it(graph: Graph) -> None:
    rig = Rig(graph)
    assert rig.change("configure")
    for fault, repair, reason, axis in FAULTS.values():
        count = len(rig.trips)
        assert rig.change("activate"), rig.state.problem
        rig.wait_for_step(1_500)
        rig.set("target_emulator", **fault)
        graph.wait_until(lambda count=count: len(rig.trips) > count, "the trip")
        trip = rig.trips[count]
        assert (trip.reason, trip.axis, trip.run) == (reason, axis, rig.state.run)
        blocks = [block_from_message(block) for block in trip.before]
        assert blocks[-1].first_step + blocks[-1].steps == trip.step
        assert sum(block.steps for block in blocks) == min(trip.step, 10_000)
        assert all(later.first_step == block.first_step + block.steps for block, later in itertools.pairwise(blocks))
        graph.wait_until(lambda: rig.life_cycle == "inactive", "the deactivation")
        graph.wait_until(lambda: rig.state.mode == BridgeState.TRIPPED and rig.state.problem, "the latched reason")
        assert not rig.change("activate")  # latched
        rig.set("target_emulator", **repair)
        graph.wait_until(lambda: _heals(rig), "the reset")


def _heals(rig: Rig) -> bool:
    """Reset the faults; true once the fault itself has gone, too."""
    rig.reset_faults()
    return rig.state.mode == BridgeState.OFF and not rig.state.problem


def test_lost_telemetry_is_counted_to_the_sample_and_every_other_sample_comes_once(graph: Graph) -> None:
    rig = Rig(graph)
    run = rig.levitate()
    bad = {"faults__to_host__loss": 0.02, "faults__to_host__duplication": 0.01, "faults__to_host__reordering": 0.01}
    rig.set("target_emulator", **bad)
    graph.wait_until(lambda: rig.state.lost >= 200, "losses")
    rig.set("target_emulator", **dict.fromkeys(bad, 0.0))
    rig.wait_for_step(rig.state.step + 2_000)
    step, lost = int(rig.state.step), int(rig.state.lost)
    graph.wait_until(lambda: rig.blocks[-1].first_step >= step, "telemetry")
    blocks = [block for block in rig.blocks if block.run == run]
    end = blocks[-1].first_step + steps_in(blocks[-1])
    places = [(block.first_step, block.first_step + steps_in(block)) for block in blocks]
    assert all(after[0] >= before[1] for before, after in itertools.pairwise(places))
    assert end - sum(stop - first for first, stop in places) == lost
    graph.wait_until(lambda: rig.values("hardware_bridge").get("samples lost") == str(lost), "diagnostics")


def test_a_killed_bridge_leaves_the_rotor_levitated_and_the_next_one_takes_over_or_lands_it(graph: Graph) -> None:
    def killed_and_started_again() -> None:
        rig.bridge.send_signal(signal.SIGKILL)
        rig.bridge.wait_for_end(60.0)
        rig.start_bridge()

    rig = Rig(graph)
    first = rig.levitate()
    killed_and_started_again()
    with AmbClient(domain_id=graph.domain, timeout=TIMEOUT) as amb:
        with pytest.raises(ClientError, match="levitated already"):
            RigStand(amb, lambda *_: None).prepare()  # of an experiment, which would land the rotor at its end
        amb.rig.disconnect()
    second = rig.levitate()
    assert second > first
    assert rig.state.mode == BridgeState.LEVITATED
    assert rig.trips == []
    record = rig.record(second, 1_000)
    assert np.abs(record.position).max() < 100e-6
    killed_and_started_again()
    assert rig.change("configure")
    graph.wait_until(lambda: rig.health("hardware_bridge")[-1].message == SETTINGS_WAIT, "a warning")
    assert rig.change("deactivate"), rig.state.problem
    graph.wait_until(lambda: rig.state.mode == BridgeState.OFF, "the landing")
    assert rig.life_cycle == "inactive"
    assert int(rig.values("target_emulator")["boots"]) == 1


def test_a_reboot_of_the_target_is_a_latched_trip_and_the_next_levitation_a_run(graph: Graph) -> None:
    from std_srvs.srv import Trigger

    rig = Rig(graph)
    first = rig.levitate()
    rig.wait_for_step(1_000)
    assert graph.call(Trigger, "/amb/target_emulator/reboot").success
    graph.wait_until(lambda: any(trip.reason == Trip.REBOOT for trip in rig.trips), "the trip")
    graph.wait_until(lambda: rig.life_cycle == "inactive", "the deactivation")
    assert not rig.change("activate")
    graph.wait_until(lambda: _heals(rig), "the reset")
    assert rig.change("activate"), rig.state.problem
    graph.wait_until(lambda: rig.state.run > first, "the next run")


def test_a_target_that_is_another_machine_after_its_reboot_must_be_configured_anew(graph: Graph) -> None:
    rig = Rig(graph)
    rig.levitate()
    rig.wait_for_step(500)
    port = rig.values("target_emulator")["UDP port"]
    graph.stop(rig.emulator, signal.SIGKILL)
    graph.start(EMULATOR, "--params-file", str(config("rig")), parameters=UNHURRIED | {"port": int(port)})
    graph.wait_until(lambda: any(trip.reason == Trip.REBOOT for trip in rig.trips), "the trip")
    graph.wait_until(lambda: rig.life_cycle == "inactive", "the deactivation")
    graph.wait_until(lambda: _reason_after_reset(rig).startswith("the target is another machine"), "the reason")
    assert not rig.change("activate")
    graph.wait_until(lambda: "activate: the target is another machine since" in rig.state.problem, "the refusal")
    assert rig.change("cleanup")
    assert rig.levitate()
    assert list(rig.state.axes) == ["x_a", "y_a", "x_b", "y_b"]


def _reason_after_reset(rig: Rig) -> str:
    rig.reset_faults()
    return str(rig.state.problem)


@pytest.mark.parametrize(("at_exit", "by"), [("land", signal.SIGHUP), ("stay", signal.SIGINT)])
def test_at_its_end_it_lands_the_rotor_or_leaves_it_as_configured(
    graph: Graph, at_exit: str, by: signal.Signals
) -> None:
    rig = Rig(graph, bridge={"at_exit": at_exit})
    rig.levitate()
    code, said = graph.stop(rig.bridge, by)
    assert code == 0, said
    wanted = "off" if at_exit == "land" else "on"
    graph.wait_until(lambda: rig.values("target_emulator").get("amplifiers") == wanted, "the amplifiers")


def test_hostile_excitations_are_answered_and_end_nothing(graph: Graph) -> None:
    rig = Rig(graph)
    rig.levitate()
    publisher = graph.node.create_publisher(Excitation, "/amb/excitation", EVERY_STATE)
    graph.wait_until(publisher.get_subscription_count, "the bridge")
    for number in range(20):
        publisher.publish(Excitation(run=rig.state.run, id=number, kind="square" if number % 2 else "waveform"))
    step = rig.state.step
    rig.wait_for_step(step + 1_000)
    assert rig.bridge.poll() is None
    assert rig.life_cycle == "active"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_session_that_is_ended_lands_the_rotor_and_leaves_no_node(
    graph: Graph, tmp_path: Path, number: signal.Signals
) -> None:
    states: list[BridgeState] = []
    graph.node.create_subscription(BridgeState, "/amb/hardware_bridge/state", states.append, EVERY_STATE)
    amb, parameters = str(find_executable("amb_bringup", "amb")), str(unhurried_file(tmp_path))
    process = graph.start_command([amb, "rig", "demo", "--out", "demo", "--params", parameters])

    def plays() -> bool:
        return any(state.excitation == BridgeState.PLAYING for state in states)

    graph.wait_until(lambda: plays() or process.poll() is not None, "the excitation", 3.0 * TIMEOUT)
    assert plays(), process.said
    process.send_signal(number)
    process.wait_for_end(TIMEOUT)
    assert process.returncode == 130, process.said
    modes = [state.mode for state in states]
    last = len(modes) - 1 - modes[::-1].index(BridgeState.LEVITATED)
    assert BridgeState.LANDING in modes[last:]  # by the command, or by the bridge at its end
    graph.wait_until(lambda: not graph.node.get_publishers_info_by_topic("/amb/telemetry"), "the end of the bridge")
