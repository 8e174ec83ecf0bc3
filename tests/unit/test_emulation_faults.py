"""Faults of the emulated target: each is seen by the host for what it is, and counted to the sample."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import validate
from amb_core.plant import PlantParameters
from amb_core.rig.emulation import FaultyLink, LinkFaults, SensorFaultParameters, UndeliveredSamples
from amb_core.rig.emulation.faulty_sensors import FaultySensors, faulty_axes
from amb_core.rig.link import LOOPBACK, InOrder, TelemetryCount, TripReason, commands
from tests.emulated_host import Bench

HEAVY = {"loss": 0.1, "duplication": 0.1, "reordering": 0.1, "corruption": 0.1}
STEPS = 5_000


def received(bench: Bench, wait: int = 200) -> TelemetryCount:
    """What a receiver counts that waits so many steps for a missing one."""
    receiver = InOrder(wait)
    for block in bench.blocks():
        receiver.add(block)
    receiver.flush()
    return receiver.count


def perfect_start_and_end(bench: Bench, **to_host: float) -> None:
    """Telemetry with faults in its middle: a receiver knows of no gap before its first frame or after its last."""
    bench.levitate()
    bench.run(50)
    bench.set_faults(to_host=to_host)
    bench.run(STEPS)
    bench.set_faults()
    bench.run(600)


def test_gaps_that_the_network_makes_are_the_gaps_that_a_receiver_finds() -> None:
    with Bench() as bench:
        bench.connect()
        perfect_start_and_end(bench, **HEAVY)
        made, counted = bench.emulator.to_host.count, received(bench)
        assert counted.lost == made.samples > 500
        assert [(gap.first, gap.stop) for gap in made.gaps] == list(counted.gaps)
        assert {gap.session for gap in made.gaps} == {bench.session.number}
        assert counted.late == 0
        assert counted.doubled > 0
        assert counted.reordered > 0
        assert min(made.lost, made.doubled, made.reordered, made.corrupted) > 50
        assert counted.delivered + counted.lost == bench.blocks()[-1].first_step + 5 - bench.blocks()[0].first_step


def test_samples_whose_frames_the_system_refuses_are_counted_once_unless_a_copy_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with Bench() as bench:
        bench.connect()
        taken, numbers = bench.emulator._listening.send, itertools.count(1)

        def send(frame: bytes, peer: tuple[int, int]) -> bool:
            return bool(bench.emulator.to_host._faults.none or next(numbers) % 3) and taken(frame, peer)

        monkeypatch.setattr(bench.emulator._listening, "send", send)
        perfect_start_and_end(bench, **HEAVY)
        made, counted = bench.emulator.to_host.count, received(bench)
        assert bench.emulator.unsent > 100
        assert counted.lost == made.samples
        made_steps = {step for gap in made.gaps for step in range(gap.first, gap.stop)}
        assert made_steps == {step for first, stop in counted.gaps for step in range(first, stop)}


def test_what_comes_later_than_a_receiver_waits_it_counts_as_lost_and_then_as_late() -> None:
    with Bench() as bench:
        bench.connect()
        perfect_start_and_end(bench, delay=0.01, delay_jitter=0.04, loss=0.05)
        made, counted = bench.emulator.to_host.count, received(bench, wait=100)
        assert counted.late > 0
        assert counted.lost - counted.late == made.samples


def test_delayed_frames_arrive_after_their_delay_and_none_is_missing() -> None:
    with Bench() as bench:
        bench.connect()
        bench.levitate()
        bench.run(50)
        before = bench.blocks()[-1].first_step
        bench.set_faults(to_host={"delay": 0.02})
        bench.run(190)
        bench.set_faults()
        assert bench.blocks()[-1].first_step == before, "nothing of the last 20 ms has arrived"
        bench.run(300)
        steps = [block.first_step for block in bench.blocks()]
        assert sorted(steps) == list(range(steps[0], bench.emulator.steps, 5))


def test_a_delayed_command_takes_effect_after_its_delay() -> None:
    with Bench() as bench:
        bench.connect()
        bench.set_faults(from_host={"delay": 0.01})
        sent = bench.emulator.steps
        bench.send(bench.writer.write(commands.heartbeat()))
        for _ in range(15):
            bench.emulator.run(10)
        assert bench.reply().status.step == sent + 100


def test_commands_that_the_network_spoils_are_counted_by_the_target() -> None:
    with Bench() as bench:
        bench.connect()
        bench.set_faults(from_host={"corruption": 0.5})
        frames = [bench.writer.write(commands.heartbeat()) for _ in range(100)]
        for frame in frames:
            bench.send(frame)
        bench.set_faults()
        status = bench.command(commands.heartbeat()).status
        assert status.bad == bench.emulator.from_host.count.corrupted > 20


def test_a_lost_command_has_no_effect_and_a_doubled_one_is_answered_twice_and_done_once() -> None:
    with Bench() as bench:
        bench.connect()
        bench.set_faults(from_host={"loss": 1.0})
        bench.send(bench.writer.write(commands.stream(5)))
        bench.run(100)
        bench.set_faults()
        assert bench.blocks() == []
        bench.set_faults(from_host={"duplication": 1.0})
        bench.send(bench.writer.write(commands.heartbeat()))
        first, second = bench.reply(), bench.reply()
        assert (first.counter, second.counter) == (3, 3)
        assert second.status.replayed == 1
        assert bench.emulator.from_host.count.lost == 1


def test_the_same_seed_makes_the_same_faults() -> None:
    def made(seed: int) -> list[UndeliveredSamples]:
        link = FaultyLink(validate(LinkFaults, HEAVY), (seed, 1))
        for frame in telemetry:
            link.send(frame, LOOPBACK, 0.0)
        return list(link.count.gaps)

    with Bench() as bench:
        bench.connect()
        bench.levitate()
        frames: list[bytes] = []
        for _ in range(50):
            bench.emulator.run(10)
            frames += bench.received()
        assert frames
        telemetry = [frame for frame in frames if frame[5] == 0x90]
    assert made(1) == made(1) != made(2)
    assert made(1)


def test_a_frame_that_no_other_overtakes_is_passed_on_all_the_same() -> None:
    link = FaultyLink(validate(LinkFaults, {"reordering": 1.0}), (0,))
    link.send(b"alone", LOOPBACK, 0.0)
    assert link.received(0.04) == []
    assert [frame for frame, _ in link.received(0.06)] == [b"alone"]
    assert link.count.reordered == 0


def test_a_stuck_sensor_trips_after_the_stuck_time() -> None:
    with Bench(limits={"stuck_time": 0.02}) as bench:
        bench.connect()
        bench.levitate()
        bench.run(500)
        stuck_since = bench.emulator.steps
        bench.set_faults(sensor={"stuck": "y"})
        bench.run(400)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert (trip.reason, trip.axis) == (TripReason.SENSOR_STUCK, 1)
        assert trip.step == stuck_since + 200


def test_a_sensor_shows_the_value_at_which_it_is_stuck_and_the_true_one_afterwards() -> None:
    with Bench(limits={"stuck_time": 0.0, "trip_share": 100.0}) as bench:
        bench.connect()
        bench.levitate()
        shown = []
        for stuck in ("y", "", "y"):
            bench.set_faults(sensor={"stuck": stuck})
            bench.run(20)
            shown.append(np.concatenate([block.position for block in bench.blocks()])[-20:, 1])
        assert [len(set(values)) for values in shown] == [1, 20, 1]
        assert shown[2][0] != shown[0][0]
        assert not bench.command(commands.heartbeat()).status.trips


def test_wrongly_wired_sensors_show_the_other_sign_or_each_others_position() -> None:
    faults = SensorFaultParameters(inverted="x_a", swapped="y_a, y_b")
    sensors = FaultySensors(("x_a", "y_a", "x_b", "y_b"), faults, 0)
    position = np.array([1.0, 2.0, 3.0, 4.0])
    sensors.apply(position)
    assert position.tolist() == [-1.0, 4.0, 3.0, 2.0]
    sensors.configure(SensorFaultParameters())
    sensors.apply(position)
    assert position.tolist() == [-1.0, 4.0, 3.0, 2.0]


def test_sensors_are_swapped_in_pairs() -> None:
    with pytest.raises(ParameterError, match=r"'faults\.sensor\.swapped' = 'x' is not allowed; allowed: two axes"):
        FaultySensors(("x", "y"), SensorFaultParameters(swapped="x"), 0)


def test_a_failed_sensor_trips_at_once() -> None:
    with Bench() as bench:
        bench.connect()
        bench.levitate()
        bench.run(100)
        step = bench.emulator.steps
        bench.set_faults(sensor={"failed": "x"})
        bench.run(10)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert (trip.reason, trip.axis, trip.step) == (TripReason.SENSOR_RANGE, 0, step)
        assert math.isnan(trip.value)


def test_a_noisy_sensor_has_its_noise_and_the_others_do_not() -> None:
    with Bench(validate(PlantParameters, {"rotor.gravity": 0.0}), limits={"stuck_time": 0.0}) as bench:
        bench.connect()
        bench.done(commands.stream(5, 1))
        bench.set_faults(sensor={"noisy": "y", "noise": 2e-6})
        bench.run(2_000)
        position = np.concatenate([block.position for block in bench.blocks()])
        assert np.ptp(position[:, 0]) == 0.0
        assert position[:, 1].std() == pytest.approx(2e-6, rel=0.1)  # 6 standard deviations of the estimate


@pytest.mark.parametrize(
    ("faults", "reason"),
    [({"amplifier": True}, TripReason.AMPLIFIER), ({"temperature": 150.0}, TripReason.TEMPERATURE)],
)
def test_amplifiers_and_temperature_trip(faults: dict[str, object], reason: TripReason) -> None:
    with Bench() as bench:
        bench.connect()
        bench.levitate()
        bench.run(100)
        step = bench.emulator.steps
        bench.set_faults(**faults)
        bench.run(10)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert (trip.reason, trip.step) == (reason, step)
        assert not bench.emulator.enabled


def test_a_fault_of_an_axis_that_is_not_there_is_refused_and_changes_nothing() -> None:
    with Bench() as bench:
        bench.connect()
        with pytest.raises(ParameterError, match=r"'faults\.sensor\.stuck' names axis 'z'; axes: x, y"):
            bench.set_faults(sensor={"stuck": "z"}, from_host={"loss": 1.0})
        bench.set_faults()
        bench.done(commands.heartbeat())


def test_axes_are_named_with_or_without_commas() -> None:
    axes = ("x_a", "y_a", "x_b", "y_b")
    faults = SensorFaultParameters(stuck="x_b, x_a", noisy="y_b x_a", failed="")
    indices = faulty_axes(faults, axes)
    assert (indices["stuck"], indices["noisy"], indices["failed"]) == ([0, 2], [0, 3], [])
