"""The emulator in real time: deadlines, what a slow machine costs, and the process in which it runs."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from amb_core.ground.errors import ParameterError, TargetError
from amb_core.ground.parameters import load_parameters, validate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.real_time import RealTimeParameters
from amb_core.plant import PlantParameters
from amb_core.rig.emulation import (
    Address,
    EmulatorProcess,
    EmulatorSettings,
    FaultParameters,
    LimitParameters,
    PacedEmulator,
    SensorFaultParameters,
    measure_load,
)
from amb_core.rig.link import (
    Description,
    Law,
    TelemetryBlock,
    TripReason,
    commands,
    decode,
    hello,
)
from tests.emulated_host import BLOCK, Bench

CONFIG = Path(__file__).parents[2] / "src" / "amb_bringup" / "config"
TOO_FAST = 1e3  # times real time: every block misses its deadline
SLOW = 0.02  # 50 ms for a block: most machines miss none


def paced(bench: Bench, factor: float) -> PacedEmulator:
    return PacedEmulator(bench.emulator, BLOCK, factor, bench.faults)


@pytest.mark.parametrize(("factor", "blocks"), [(TOO_FAST, 50), (SLOW, 3)])
def test_missed_deadlines_are_counted_and_cost_the_target_as_many_steps_as_they_are_late(
    factor: float, blocks: int
) -> None:
    period = 100_000  # ns
    with Bench(limits={"missed_steps": 1e9}) as bench:
        bench.connect()
        bench.levitate()
        loop, missed, late_blocks = paced(bench, factor), 0, 0
        assert loop.pace is not None
        loop.start()
        for _ in range(blocks):
            due = bench.emulator.time + BLOCK * period
            loop.run_block()
            late = bench.emulator.time - due
            late_blocks += late > 0
            missed += (late + period // 2) // period
        assert (loop.pace.missed, loop.pace.lateness.count) == (late_blocks, blocks)
        assert late_blocks == blocks or factor == SLOW
        bench.run(10)
        status = bench.command(commands.heartbeat()).status
        assert (status.missed, status.trips) == (missed, ())


def test_a_machine_that_is_late_beyond_the_limit_trips_the_watchdog() -> None:
    with Bench(limits={"missed_steps": 20.0}) as bench:
        bench.connect()
        bench.levitate()
        loop = paced(bench, TOO_FAST)
        loop.start()
        loop.run_block()
        bench.run(10)
        (trip,) = bench.command(commands.heartbeat()).status.trips
        assert trip.reason is TripReason.WATCHDOG


def test_in_lock_step_a_late_machine_costs_no_step_until_the_host_is_gone() -> None:
    with Bench(limits={"missed_steps": 20.0}, host_patience=0.5) as bench:
        bench.connect()
        bench.done(commands.controller(Law.HOST))
        bench.levitate(rows=1)
        loop = paced(bench, TOO_FAST)
        loop.start()
        with answering(bench):
            for _ in range(5):
                loop.run_block()
            late = bench.emulator.time - 100_000 * bench.emulator.steps
        status = bench.emulator.status()
        assert status is not None
        assert (late, status.trips, status.missed) == (0, (), 0)
        loop.run_block()  # waits in vain, then goes on
        assert bench.emulator.time > 100_000 * bench.emulator.steps


@contextmanager
def answering(bench: Bench) -> Iterator[None]:
    """A host that answers each position with currents of 0."""
    ended = threading.Event()

    def answer() -> None:
        while not ended.is_set():
            for frame in bench.received():
                block = decode(frame, bench.session)
                if isinstance(block, TelemetryBlock):
                    bench.socket.sendto(
                        commands.current(bench.session, block.first_step, (0.0, 0.0)),
                        ("127.0.0.1", bench.emulator.port),
                    )

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_a_clock_that_drifts_changes_the_pace_and_not_the_steps() -> None:
    with Bench() as bench:
        loop = paced(bench, 1.0)
        assert loop.pace is not None
        assert loop.pace.period == pytest.approx(1e-3, rel=1e-12)
        loop.configure(validate(FaultParameters, {"clock_drift": 100.0}))
        assert loop.pace.period == pytest.approx(1e-3 / 1.0001, rel=1e-12)
        before = bench.emulator.time
        loop.start()
        loop.run_block()
        assert bench.emulator.time - before - round(1e9 * loop.pace.shift) == pytest.approx(1_000_000, abs=1)


def test_without_pace_nothing_waits_and_nothing_is_late() -> None:
    with Bench() as bench:
        loop = paced(bench, 0.0)
        loop.start()
        for _ in range(100):
            loop.run_block()
        assert loop.pace is None
        assert bench.emulator.time == 100_000_000


# -- load


def test_a_plant_that_is_too_slow_is_reported_with_what_to_switch_off() -> None:
    plant = load_parameters(PlantParameters, CONFIG / "rig.yaml", "simulator", part=True)
    alone = measure_load(plant, ControllerParameters(), 0.01)
    assert 0.0 < alone.share < 0.9
    assert alone.remedy == ()
    load = measure_load(plant, ControllerParameters(), 100.0)
    assert load.share > 10.0
    shares = [load.share, *(share for _, share in load.remedy)]
    assert shares == sorted(shares, reverse=True)
    names = [name for name, _ in load.remedy]
    assert names[0] == "integration.internal_step: 1e-06"
    assert "iron.hysteresis: false, iron.saturation: false" in names
    assert "too slow for this pace" in str(load)
    assert all(name in str(load) for name in names)


def test_sensors_that_show_the_same_position_bit_for_bit_are_named() -> None:
    plant = load_parameters(PlantParameters, CONFIG / "thrust.yaml", "simulator", part=True)
    controller = load_parameters(ControllerParameters, CONFIG / "thrust.yaml", "pd_controller", part=True)
    assert measure_load(plant, controller, 0.0).still == ("z",)
    noisy = plant.model_copy(update={"sensor": plant.sensor.model_copy(update={"noise": 1e-8})})
    assert measure_load(noisy, controller, 0.0).still == ()


# -- process


def settings(**changes: object) -> EmulatorSettings:
    given = {
        "plant": PlantParameters(),
        "controller": ControllerParameters(),
        "limits": LimitParameters(),
        "faults": FaultParameters(),
        "address": Address(port=0),
        "block_steps": 10,
        "real_time_factor": 0.0,
        "real_time": RealTimeParameters(),
    }
    return EmulatorSettings(**(given | changes))  # type: ignore[arg-type]


def description(port: int) -> Description:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.settimeout(60.0)
        host.sendto(hello(), ("127.0.0.1", port))
        answer = decode(host.recv(2048))
    assert isinstance(answer, Description)
    return answer


def test_an_emulator_in_its_own_process_answers_reboots_takes_faults_and_ends() -> None:
    process = EmulatorProcess(settings())
    try:
        before = description(process.started.port)
        assert process.latest.boots == 1
        assert process.reboot().boots == 2
        assert description(process.started.port).nonce != before.nonce
        process.configure(FaultParameters(sensor=SensorFaultParameters(failed="x")))
        report = process.reboot()
        assert report.steps > 0
        assert report.from_host.frames == 2
        assert (report.pace, report.enabled, report.trouble) == (None, False, "")
    finally:
        process.close()
    assert process.returncode == 0
    with pytest.raises(TargetError, match="the process of the emulator has ended"):
        process.reboot()


def test_an_emulator_that_cannot_start_reports_why() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(
            TargetError, match=f"UDP port {port} of 127.0.0.1 cannot be opened: Address already in use; .*link.port"
        ):
            EmulatorProcess(settings(address=Address(port=port)))


def test_a_pace_at_which_commands_would_wait_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"factor = 0\.01 .* block_steps = 10 at .*; allowed: 0, or from 0\.02"):
        settings(real_time_factor=0.01)
    assert settings(real_time_factor=0.02).block_time == pytest.approx(0.05)


def test_a_wrong_plant_is_reported_by_the_process() -> None:
    plant = validate(PlantParameters, {"iron.saturation": True, "iron.bh_table": "missing.csv"})
    with pytest.raises(TargetError, match=r"missing\.csv"):
        EmulatorProcess(settings(plant=plant))
