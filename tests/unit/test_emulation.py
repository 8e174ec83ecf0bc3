"""The target emulator: the C target around the plant on a real UDP socket, the same samples as the simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from amb_core.excitation import Square, generate
from amb_core.ground.errors import TargetError
from amb_core.ground.parameters import load_parameters, validate
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.rig.emulation import Address, FaultParameters, LimitParameters, TargetEmulator, reference_library
from amb_core.rig.link import TargetState, TripReason, commands, excitation_upload
from tests.emulated_host import Bench

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"
STEPS, EXCITED = 1_500, 400


@pytest.mark.parametrize("config", ["paper", "rig", "thrust"])
def test_samples_over_udp_are_those_of_the_simulation_bit_for_bit(config: str) -> None:
    file = CONFIG / f"{config}.yaml"
    parameters = load_parameters(PlantParameters, file, "simulator", part=True)
    controller = load_parameters(ControllerParameters, file, "pd_controller", part=True)
    # Without gravity an ideal sensor shows the same z bit for bit.
    with Bench(parameters, controller, {"stuck_time": 0.0}) as bench:
        axes = len(bench.connect().page)
        excitation = generate(
            Square(amplitude=20e-6, duration=0.06, frequency=50.0, axes="all"), 10_000.0, bench.emulator.plant.machine
        ).samples
        bench.done(commands.nominal_reference(controller.references(axes)))
        bench.run(30)
        bench.upload(excitation_upload(1, excitation))
        first = bench.levitate()
        bench.run(10)
        bench.done(commands.arm(1, first + EXCITED))
        bench.run(STEPS)
        law = PdController(controller, axes)
        assert bench.record(first, STEPS).identical_to(simulate(Plant(parameters), law, STEPS, excitation, EXCITED))
        assert bench.command(commands.heartbeat()).status.state is TargetState.LEVITATED


def test_a_second_levitation_starts_where_the_first_did() -> None:
    parameters = validate(PlantParameters, {"sensor.noise": 1e-7, "rotor.initial_y": -50e-6})
    with Bench(parameters) as bench:
        bench.connect()
        first = bench.levitate()
        bench.run(200)
        bench.done(commands.delevitate(0.0))
        bench.run(50)
        assert bench.blocks()[-1].position.tolist()[-1] == list(Plant(parameters).position)
        assert not bench.emulator.enabled
        again = bench.levitate()
        bench.run(200)
        law = PdController(ControllerParameters())
        expected = simulate(Plant(parameters), law, 200)
        for start in (first, again):
            block = next(block for block in bench.blocks() if block.first_step == start)
            assert np.array_equal(block.position, expected.position[:5])
        assert bench.record(again, 200).identical_to(expected)


def test_the_coil_currents_are_those_of_the_plant_and_0_while_the_amplifiers_are_off() -> None:
    with Bench(limits={"settle_time": 1.0}) as bench:
        bench.connect()
        first = bench.levitate(options=7)
        bench.run(100)
        plant, law = Plant(), PdController(ControllerParameters())
        measured = []
        for _ in range(99):
            measured.append(plant.coil_currents)
            plant.advance(law.update(plant.position, (0.0, 0.0)))
        there = np.concatenate([block.coil_current for block in bench.blocks() if block.first_step >= first])
        assert np.array_equal(there[:99], measured)
        assert there[0].tolist() == [0.0] * 4
        assert there[50:].mean() == pytest.approx(3.0, abs=0.5)
        bench.done(commands.delevitate(0.0))
        bench.run(20)
        assert bench.blocks()[-1].coil_current.tolist()[-1] == [0.0] * 4


def test_a_rotor_that_touches_the_backup_bearing_makes_the_amplifiers_report_a_fault() -> None:
    weak = ControllerParameters(proportional_gain=1_000.0)
    with Bench(controller=weak, limits={"trip_share": 10.0}) as bench:
        bench.connect()
        first = bench.levitate()
        bench.run(2_000)
        expected = simulate(Plant(), PdController(weak), 2_000)
        fallen = first + len(expected.position)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert (trip.reason, trip.step) == (TripReason.AMPLIFIER, fallen)
        assert "touched the backup bearing" in bench.emulator.trouble
        positions = np.concatenate([block.position for block in bench.blocks() if block.first_step >= first])
        rested = np.hypot(*positions[fallen - first])
        assert rested > 250e-6, "at the trip it lies where it touched"
        assert np.array_equal(positions[fallen - first + 1], Plant().position), "afterwards at rest"
        bench.done(commands.fault_reset())
        again = bench.levitate()
        bench.run(50)
        assert bench.record(again, 50).identical_to(expected.window(0, 50))


def test_a_reboot_forgets_session_and_levitation() -> None:
    with Bench() as bench:
        bench.connect()
        bench.levitate()
        bench.run(100)
        assert bench.emulator.enabled
        before = bench.session.number
        bench.emulator.reboot()
        bench.run(50)
        assert not bench.emulator.enabled
        description = bench.connect()
        assert bench.session.number != before
        assert description.counter == 0
        status = bench.command(commands.heartbeat()).status
        assert (status.state, status.missed, status.step) == (TargetState.OFF, 0, 50)


def test_a_late_clock_is_missed_steps_and_beyond_the_limit_a_trip_of_the_watchdog() -> None:
    with Bench(limits={"missed_steps": 20.0}) as bench:
        bench.connect()
        bench.levitate()
        bench.run(100)
        bench.emulator.shift(19 * 1e-4)
        bench.run(10)
        status = bench.command(commands.heartbeat()).status
        assert (status.missed, status.trips) == (19, ())
        bench.emulator.shift(20 * 1e-4)
        step = bench.emulator.steps
        bench.run(10)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert (trip.reason, trip.step) == (TripReason.WATCHDOG, step)
        assert 38.0 < trip.value < 39.0  # both misses, less what the steps in between have paid back


def test_a_wrong_key_is_refused_and_the_right_one_taken() -> None:
    key = bytes(range(32))
    with Bench(key=key, host_key=bytes(32)) as bench:
        bench.connect()
        bench.send(bench.writer.write(commands.heartbeat()))
        bench.connect()
        assert bench.received() == []
    with Bench(key=key) as bench:
        assert bench.connect().with_key
        assert bench.command(commands.heartbeat()).status.forged == 0


def test_without_a_key_only_this_machine_is_listened_to() -> None:
    with pytest.raises(TargetError, match=r"address '0\.0\.0\.0' without a key .* allowed: 127\.0\.0\.1, or a key"):
        Address("0.0.0.0")
    with pytest.raises(TargetError, match="address 'rig' is not allowed; allowed: an IPv4 address"):
        Address("rig")
    assert Address("0.0.0.0", key=bytes(32)).host == "0.0.0.0"


def test_a_port_that_is_taken_is_named() -> None:
    with Bench() as bench:
        port = bench.emulator.port
        with pytest.raises(
            TargetError, match=f"UDP port {port} of 127.0.0.1 cannot be opened: Address already in use; .*link.port"
        ):
            TargetEmulator(
                PlantParameters(),
                ControllerParameters(),
                LimitParameters(),
                FaultParameters(),
                reference_library(),
                Address(port=port),
            )


def test_hostile_datagrams_change_nothing() -> None:
    with Bench() as bench:
        bench.connect()
        bench.levitate()
        for datagram in (b"", b"x", b"AMBU", bytes(1472), bytes(1473), bytes(9_000)):
            bench.send(datagram)
        bench.run(20)
        status = bench.command(commands.heartbeat()).status
        assert (status.state, status.bad) == (TargetState.LEVITATED, 5)


@pytest.mark.parametrize("plant_waits", [False, True])
def test_the_rotor_moves_in_steps_that_are_missed_unless_it_is_to_wait(plant_waits: bool) -> None:
    plant = validate(PlantParameters, {"rotor.initial_y": -50e-6})
    with Bench(plant, limits={"missed_steps": 1e9}, plant_waits=plant_waits) as bench:
        bench.connect()
        first = bench.levitate()
        bench.run(20)
        samples = bench.emulator.plant.samples
        bench.emulator.shift(30 * 1e-4)
        assert bench.emulator.plant.samples - samples == (0 if plant_waits else 30)
        bench.run(100)
        law = PdController(ControllerParameters())
        undisturbed = simulate(Plant(plant), law, 100)
        assert bench.record(first, 100).identical_to(undisturbed) == plant_waits
        bench.done(commands.delevitate(0.0))
        bench.emulator.shift(1.0)  # while off, it stays where it lies
        bench.run(10)
        assert not bench.emulator.enabled


def test_a_pause_of_the_machine_drops_the_rotor_as_it_would_on_a_rig() -> None:
    with Bench(limits={"missed_steps": 1e9, "settle_time": 0.001}, plant_waits=False) as bench:
        bench.connect()
        bench.levitate()
        bench.run(200)
        bench.emulator.shift(0.1)
        bench.run(10)
        trips = bench.command(commands.heartbeat()).status.trips
        assert {trip.reason for trip in trips} & {TripReason.DISPLACEMENT, TripReason.AMPLIFIER}
