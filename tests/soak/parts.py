"""The parts of the soak: each returns its figures for results/soak.json."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from amb_bringup.client.errors import ClientError
from amb_bringup.demos.demo_run import plant_of
from amb_core.excitation import Multisine, Square
from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.pace import QUANTILES
from amb_core.loop.real_time import RealTimeParameters
from amb_core.recording import audit_steps
from amb_core.rig.emulation import Address, EmulatorProcess, EmulatorSettings, FaultParameters, LimitParameters
from amb_core.rig.emulation.emulator import TargetEmulator
from amb_core.rig.emulation.library import reference_library
from amb_core.rig.emulation.paced import PacedEmulator
from amb_core.rig.link import AmbUdpLink, TargetSettings, TargetState, TargetStatus, TelemetryBlock
from amb_msgs.msg import BridgeState
from tests.soak.session import HOST, Session, emulator_port
from tests.soak.tap import Tap

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "src" / "amb_bringup" / "config"
RIGID = ROOT / "tests" / "benchmarks" / "rigid.yaml"  # four axes, PWM and all, without hysteresis
PAPER = CONFIG / "paper.yaml"
PATIENT = {"limits": {"missed_steps": 1e9, "host_time": 0.2}, "plant_waits": True, "ideal": True}
MULTISINE = Multisine(
    amplitude=1e-6, axes="orthogonal", duration=4.0, periods=2, frequency_start=2.0, frequency_end=600.0, odd=True
)
LOSSES = {"loss": 0.01, "duplication": 0.005, "reordering": 0.005, "corruption": 0.001}
BLOCK, HELD_UP = 10, 0.01  # steps in a paced block, and share of the blocks that are held up
LATENESS = dict(zip(("p50_us", "p99_us", "p9999_us", "max_us"), QUANTILES.values(), strict=True))
PERIOD = 2.0  # s between looks at the processes


def soak(folder: Path, seconds: float = 600.0) -> dict[str, Any]:
    """Four axes in real time, recorded: every sample once, and what the host's processes need."""
    with Session(folder, RIGID, target_emulator=PATIENT, hardware_bridge={"levitation_time": 0.5}) as session:
        amb = session.amb
        amb.rig.connect()
        bag = Path(amb.start_recording(folder / "soak_bag"))
        run = amb.rig.levitate()
        looks = _run_and_look(session, seconds)
        amb.rig.land()
        state = amb.rig.wait_for_state()
        amb.stop_recording(run, int(state.step))
        emulator = session.diagnostics["target_emulator"]
    audit = audit_steps(bag, run)
    settled = [look for look in looks if look["time"] > min(60.0, 0.2 * seconds)]
    first, last = settled[0], settled[-1]
    span = last["time"] - first["time"]
    memory = [sum(look["memory"].values()) for look in settled]
    tail = len(memory) // 5 or 1
    return {
        "soak": {
            "seconds": seconds,
            "axes": 4,
            "samples": int(state.step),
            "lost": audit.lost(0, int(state.step)),
            "doubled": audit.doubled,
            "out_of_order": audit.out_of_order,
            "lost_on_link": int(state.lost),
            "bridge_cores": (last["cpu"]["hardware_bridge"] - first["cpu"]["hardware_bridge"]) / span,
            "host_cores": sum(last["cpu"][node] - first["cpu"][node] for node in HOST) / span,
            "cores_by_node": {node: (last["cpu"][node] - first["cpu"][node]) / span for node in HOST},
            "memory_growth_percent": 100.0 * (np.median(memory[-tail:]) / np.median(memory[:tail]) - 1.0),
            "trips": [str(trip.text) for trip in amb.rig.trips],
        },
        "pace": {
            **{key: float(emulator[f"lateness {label} (us)"]) for key, label in zip(LATENESS, QUANTILES, strict=True)},
            "missed": int(emulator["deadlines missed"]),
            "steps_missed": int(state.missed),
        },
    }  # fmt: skip


def pace(seconds: float = 60.0) -> dict[str, Any]:
    """An emulator alone in real time, some of whose blocks are held up on purpose: each must count as missed."""
    settings = plant_of(PAPER).parameters, ControllerParameters(), LimitParameters(), FaultParameters()
    emulator = TargetEmulator(*settings, reference_library(), Address(port=0))
    paced, injected, counted = PacedEmulator(emulator, BLOCK, 1.0, FaultParameters()), 0, 0
    assert paced.pace is not None
    draw = random.Random(1)
    paced.start()
    for _ in range(round(seconds / paced.pace.period)):
        before, held_up = paced.pace.missed, draw.random() < HELD_UP
        if held_up:
            time.sleep(2.0 * paced.pace.period)
        paced.run_block()
        injected += held_up
        counted += held_up and paced.pace.missed > before
    emulator.close()
    lateness = {key: 1e6 * paced.pace.lateness.quantile(share) for key, share in LATENESS.items()}
    return {"pace": {**lateness, "missed": paced.pace.missed, "injected": injected, "counted": counted}}


def _run_and_look(session: Session, seconds: float) -> list[dict[str, Any]]:
    """Excite again and again for so many seconds; processor time and memory of the host's processes."""
    processes = {node: session.process(node) for node in HOST}
    began, looks, until = time.monotonic(), [], 0.0
    while (now := time.monotonic() - began) < seconds:
        if now > until:
            try:
                session.amb.start_excitation(MULTISINE.kind, **MULTISINE.model_dump())
            except ClientError as problem:
                print(f"excitation at {now:.0f} s: {problem}", flush=True)
                session.amb.rig.reset_faults()
            until = now + 20.0
        cpu = {node: sum(process.cpu_times()[:2]) for node, process in processes.items()}
        memory = {node: process.memory_info().rss for node, process in processes.items()}
        looks.append({"time": now, "cpu": cpu, "memory": memory})
        end = time.monotonic() + PERIOD
        while time.monotonic() < end:
            session.amb.spin_once(0.1)
    return looks


class _Listener:
    def __init__(self) -> None:
        self.blocks: list[TelemetryBlock] = []

    def on_samples(self, block: TelemetryBlock) -> None:
        self.blocks.append(block)

    def on_status(self, status: TargetStatus) -> None:
        pass

    def on_silence(self) -> None:
        print("the target is silent", flush=True)

    def on_return(self, description: object, rebooted: bool) -> None:
        print("the target is back", flush=True)


def link(samples: int = 100_000) -> dict[str, Any]:
    """A bad network, both ways: an upload of 4 x 100 000 samples, and gaps to the sample.

    Parameters
    ----------
    samples : int, optional
        Uploaded, and played, on each axis.
    """
    plant = plant_of(RIGID)
    settings = EmulatorSettings(
        plant.parameters, ControllerParameters(), validate(LimitParameters, PATIENT["limits"] | {"host_time": 1e3}),
        FaultParameters(), Address(port=0), 10, 1.0, RealTimeParameters(), plant_waits=True,
    )  # fmt: skip
    emulator = EmulatorProcess(settings)
    listener = _Listener()
    connection = AmbUdpLink(port=emulator.started.port, float64=True, timeout=10.0, silence=10.0)
    try:
        description = connection.connect(listener)
        connection.configure(TargetSettings(ControllerParameters(), description.limits, ()))
        connection.levitate(0.0)
        while connection.status().state is not TargetState.LEVITATED:
            time.sleep(0.01)
        emulator.configure(validate(FaultParameters, {"to_host": LOSSES, "from_host": LOSSES}))
        wave = np.random.default_rng(1).uniform(-1e-8, 1e-8, (samples, 4))
        began = time.monotonic()
        arm = connection.upload(wave)
        upload = time.monotonic() - began
        step = connection.status().step + 2_000
        arm(step)
        while (status := connection.status()).step < step + samples + 200:  # by the target's clock, which may run late
            if status.state is not TargetState.LEVITATED:
                raise RuntimeError(f"the target does not levitate any more; it is {status}")
            time.sleep(0.1)
        emulator.configure(FaultParameters())
        time.sleep(1.0)
        wanted = connection.status().step
        while emulator.latest.steps < wanted:
            emulator.ask_for_report()
            time.sleep(0.01)
        injected, gaps = emulator.latest.to_host, connection.count.samples
        played = np.full((samples + 200, 4), np.nan)
        for block in listener.blocks:
            first = block.first_step - (step - 100)
            if first >= 0 and first + block.steps <= len(played):
                played[first : first + block.steps] = block.reference
        there = ~np.isnan(played[:, 0])
        expected = np.vstack([np.zeros((100, 4)), wave, np.zeros((100, 4))])
        moved = np.flatnonzero(there & (played != 0.0).any(axis=1))
        return {
            "link": {
                "injected_gaps": injected.samples,
                "reported_gaps": gaps.lost,
                "late": gaps.late,
                "doubled": gaps.doubled,
                "upload_s": upload,
                "upload_exact": bool(np.array_equal(played[there], expected[there])),
                "samples_compared": int(there.sum()),
                "start_step_error": int(moved[0]) - 100,
            }
        }
    finally:
        connection.close()
        emulator.close()


def lifecycle(folder: Path, count: int = 100) -> dict[str, Any]:
    """Wrong transitions in every state of the life cycle."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    wrong = {
        "unconfigured": ("activate", "deactivate", "cleanup", "nonsense"),
        "inactive": ("configure", "deactivate", "nonsense"),
        "active": ("configure", "activate", "cleanup", "nonsense"),
    }
    refused = asked = 0
    with Session(folder, PAPER, target_emulator=PATIENT, hardware_bridge={"levitation_time": 0.0}) as session:
        amb = session.amb
        amb.wait_for_nodes()
        client = amb.node.create_client(ChangeState, "hardware_bridge/change_state")
        session.wait_until(client.service_is_ready, "the bridge")
        for state, labels in wrong.items():
            if state == "inactive":
                amb.rig.connect()
            if state == "active":
                amb.rig.levitate()
            for number in range(count // 3 + 1):
                if asked == count:
                    break
                answer = client.call_async(
                    ChangeState.Request(transition=Transition(label=labels[number % len(labels)]))
                )
                session.wait_until(answer.done, "an answer")
                asked += 1
                refused += not answer.result().success and amb.rig.life_cycle() == state
        alive = session.graph.processes["hardware_bridge"].poll() is None
    return {"lifecycle": {"wrong": asked, "refused": refused, "alive": alive}}


def kills(folder: Path, rounds: int = 20) -> dict[str, Any]:
    """Kill and start again bridge, generator, recorder, and the host as a whole, while the rotor is excited."""
    recovered = tried = 0
    times: list[float] = []
    square = Square(amplitude=10e-6, duration=5.0, frequency=20.0)
    limit = 10e-6  # m, of a step: that of the square itself; a fade and everything else is slower
    bridge = {"levitation_time": 0.0, "at_exit": "stay"}
    with (
        Tap(emulator_port()) as tap,
        Session(folder, PAPER, tap.port, target_emulator=PATIENT, hardware_bridge=bridge) as session,
    ):
        session.amb.rig.connect()
        session.amb.rig.levitate()
        tap.steepest = 0.0
        for number in range(rounds):
            for victims in (("hardware_bridge",), ("excitation_generator",), ("recorder",), HOST):
                session.wait_until(lambda: _clean(session), "a clean state")
                _patiently(session, lambda: session.amb.start_excitation("square", **square.model_dump()))
                session.amb.rig.wait_for_step(int(session.amb.rig.wait_for_state().step) + 1_000)
                session.kill(*victims)
                began = time.monotonic()
                session.start(*victims)
                session.come_anew()
                if "hardware_bridge" in victims:
                    session.amb.rig.connect()
                    _patiently(session, session.amb.rig.levitate)
                times.append(time.monotonic() - began)
                tried += 1
                levitated = session.amb.rig.wait_for_state().mode == BridgeState.LEVITATED
                session.wait_until(
                    lambda: "amplifiers" in session.diagnostics.get("target_emulator", {}), "diagnostics"
                )
                on = session.diagnostics["target_emulator"]["amplifiers"] == "on"
                recovered += levitated and on
                if not (levitated and on):
                    print(f"round {number}, {victims}: {session.amb.rig.state}", flush=True)
        jumps = int(tap.steepest > 2.0 * limit * 1.0001)
        return {
            "kills": {
                "rounds": tried,
                "recovered": recovered,
                "jumps": jumps,
                "steepest_um_per_step": 1e6 * tap.steepest,
                "median_s": float(np.median(times)),
                "longest_s": max(times),
            }
        }


def _patiently(session: Session, work: Callable[[], object]) -> None:
    """Do something that latched trips forbid: an excitation that lost its host is one, and has to be reset first."""
    try:
        work()
    except ClientError as problem:
        if "latched" not in str(problem):
            raise
        session.amb.rig.reset_faults()
        try:
            work()
        except ClientError:
            print("trips:", [str(trip.text) for trip in session.amb.rig.trips], flush=True)
            raise


def _clean(session: Session) -> bool:
    """No latched trip: an excitation that lost its host is one, and the loop goes on."""
    rig = session.amb.rig
    session.amb.spin_once(0.05)
    if rig.wait_for_state().problem:
        rig.reset_faults()
        session.amb.spin_once(0.05)
    return not rig.wait_for_state().problem


def bridge_fuzz(folder: Path, frames: int = 1_000_000) -> dict[str, Any]:
    """Hostile frames to the bridge while it levitates a rotor: it lives, logs nothing unexpected, and does not grow."""
    with (
        Tap(emulator_port()) as tap,
        Session(folder, PAPER, tap.port, target_emulator=PATIENT, hardware_bridge={"levitation_time": 0.0}) as session,
    ):
        amb = session.amb
        amb.rig.connect()
        amb.rig.levitate()
        process = session.process("hardware_bridge")
        tap.attack(True)
        session.wait_until(lambda: tap.hostile > frames // 10, "the first frames", 600.0)
        before = process.memory_info().rss
        session.wait_until(lambda: tap.hostile >= frames, "all frames", 3_000.0)
        tap.attack(False)
        step = int(amb.rig.wait_for_state().step)
        session.wait_until(lambda: int(amb.rig.wait_for_state().step) > step + 5_000, "telemetry after it")
        grown = 100.0 * (process.memory_info().rss / before - 1.0)
        lines = session.graph.lines("hardware_bridge")
        exceptions = sum("Traceback" in line or "internal error" in line for line in lines)
        alive = process.is_running()
        session.wait_until(
            lambda: "frames refused" in session.diagnostics.get("hardware_bridge", {}), "diagnostics since it connected"
        )
        refused = session.diagnostics["hardware_bridge"]["frames refused"]
    return {
        "fuzz": {
            "bridge_frames": tap.hostile,
            "bridge_exceptions": exceptions + (not alive),
            "bridge_memory_growth_percent": grown,
            "bridge_frames_refused": int(refused),
        }
    }
