"""Trips of every kind that a target latches, many times, through the bridge and into the bag."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader

from amb_bringup.client.errors import ClientError
from amb_bringup.demos.demo_run import controller_of
from amb_core.excitation import Square
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.linear_control import pd_as_linear
from amb_msgs.msg import BridgeState, Trip
from amb_ros.requests import PendingRequest
from tests.soak.session import Session

SQUARE = Square(amplitude=5e-6, duration=20.0, frequency=20.0)
HOST_TIME = 0.2  # s
MISSED = 5_000  # steps: more than a loaded machine stops a process for
BEFORE = 10_000  # steps of telemetry in a trip
GROWTH = 1.1  # of a state of a controller in each step: more than the largest number after 7500 steps


@dataclass(frozen=True)
class Kind:
    """A kind of trip: what causes it and what ends the cause, and what must be found in the bag."""

    reason: int
    cause: Callable[[Session], None]
    repair: Callable[[Session], None] = lambda session: None
    axis: str = ""
    steps: int = 1_000  # of the run before the cause
    stays: bool = False  # the loop stays closed


def _emulator(fault: str, value: object) -> Callable[[Session], None]:
    return lambda session: _set(session, "target_emulator", **{f"faults.{fault}": value})


def _excite(session: Session) -> None:
    session.amb.start_excitation("square", **SQUARE.model_dump())
    step = int(session.amb.rig.wait_for_state().step)
    session.amb.rig.wait_for_step(step + 1_000)


def _silence(session: Session) -> None:
    """Every frame to the target is lost for longer than it waits for its host."""
    _excite(session)
    _emulator("from_host.loss", 1.0)(session)
    rig = session.amb.rig  # whose telemetry goes on
    rig.wait_for_step(int(rig.wait_for_state().step) + round(2.0 * HOST_TIME * 10_000))
    _emulator("from_host.loss", 0.0)(session)


def _lower_the_limit(session: Session) -> None:
    _excite(session)
    _limit(1e-6)(session)


def _limit(amplitude: float) -> Callable[[Session], None]:
    return lambda session: _set(session, "hardware_bridge", **{"protection.excitation_amplitude": amplitude})


def _freeze(session: Session) -> None:
    """Stop the process of the target for longer than its watchdog allows."""
    (target,) = [
        child for child in session.process("target_emulator").children() if "worker" in " ".join(child.cmdline())
    ]
    target.send_signal(signal.SIGSTOP)
    time.sleep(1.5 * MISSED / 10_000)
    psutil.Process(target.pid).send_signal(signal.SIGCONT)


INVERTED = _emulator("sensor.inverted", "x"), _emulator("sensor.inverted", "")
EVERY_RIG = {
    "sensor stuck": Kind(Trip.SENSOR_STUCK, _emulator("sensor.stuck", "y"), _emulator("sensor.stuck", ""), "y"),
    "sensor range": Kind(Trip.SENSOR_RANGE, _emulator("sensor.failed", "x"), _emulator("sensor.failed", ""), "x"),
    "amplifier": Kind(Trip.AMPLIFIER, _emulator("amplifier", True), _emulator("amplifier", False)),
    "temperature": Kind(Trip.TEMPERATURE, _emulator("temperature", 300.0), _emulator("temperature", 20.0)),
    "displacement": Kind(Trip.DISPLACEMENT, *INVERTED, "x", 6_000),  # not before the rotor has settled
    "watchdog": Kind(Trip.WATCHDOG, _freeze),
    "host silent": Kind(Trip.HOST_SILENT, _silence, stays=True),
    "excitation": Kind(Trip.EXCITATION, _lower_the_limit, _limit(0.0), "x", stays=True),
}
WEAK_COILS = {"over-current": Kind(Trip.OVER_CURRENT, *INVERTED)}
OVERFLOW = {"law": Kind(Trip.LAW, lambda session: None, axis="x", steps=100)}


def trips(folder: Path, machine: Path, each: int = 50) -> dict[str, Any]:
    """So many trips of every kind: reason, axis, latched, and the second before it in the bag."""
    limits = {"missed_steps": float(MISSED), "missed_share": 1.0, "host_time": HOST_TIME}
    limits |= {"saturation_time": 100.0, "lock_time": 1e-3}
    patient = {"silence": 20.0, "timeout": 20.0}  # a process of a loaded machine that waits for its turn has not gone
    weak = {**limits, "coil_current": 5.0, "settle_time": 100.0, "lift_time": 100.0}
    law = folder / "overflow.json"
    overflowing(pd_as_linear(controller_of(machine))).save(law)
    rigs: list[tuple[dict[str, Kind], dict[str, float], dict[str, Any]]] = [
        (EVERY_RIG, limits, {}),
        (WEAK_COILS, weak, {}),
        (OVERFLOW, limits, {"controller_file": str(law)}),
    ]
    tried: Counter[str] = Counter()
    right: Counter[str] = Counter()
    whole = named = 0
    for number, (kinds, of_target, of_bridge) in enumerate(rigs):
        emulator = {"limits": of_target, "plant_waits": True, "ideal": True}
        bridge = {"levitation_time": 0.0, "link": patient, **of_bridge}
        with Session(folder, machine, target_emulator=emulator, hardware_bridge=bridge) as session:
            session.amb.rig.connect()
            bag = Path(session.amb.start_recording(folder / f"trips_{number}"))
            done = [(name, *_provoke(session, kind)) for _ in range(each) for name, kind in kinds.items()]
            session.amb.stop_recording()
        recorded = _recorded(bag)
        for name, run, latched in done:
            tried[name] += 1
            trip = recorded.get((run, kinds[name].reason))
            good = latched and trip is not None and _complete(trip, kinds[name])
            right[name] += good
            whole += trip is not None and _lacking(trip) == 0
            named += trip is not None and f"; {_lacking(trip)} of the " in trip.text
            if not good:
                blocks = [(block.first_step, len(block.axes[0].position)) for block in trip.before] if trip else []
                print(f"{name}, run {run}: latched {latched}, {trip and trip.text}, {blocks}", flush=True)
    return {
        "trips": {
            "tried": tried.total(), "right": right.total(), "whole": whole, "lack_named": named, "kinds": dict(right),
        }
    }  # fmt: skip


def overflowing(model: StateSpaceModel) -> StateSpaceModel:
    """The same controller with one state more, which nothing sees until it is beyond the largest number."""
    order, outputs = len(model.a), len(model.output_names)
    return replace(
        model,
        a=np.block([[model.a, np.zeros((order, 1))], [np.zeros((1, order)), np.full((1, 1), GROWTH)]]),
        b=np.vstack([model.b, np.ones((1, model.b.shape[1]))]),
        c=np.hstack([model.c, np.zeros((outputs, 1))]),
        k=np.vstack([np.full((order, outputs), 1e-9), np.zeros((1, outputs))]),  # given, so that none is looked for
        initial_state=np.append(model.initial_state, 0.0),
    )


def _provoke(session: Session, kind: Kind) -> tuple[int, bool]:
    """One trip; its run, and whether it was latched until the reset."""
    rig = session.amb.rig
    if rig.life_cycle() == "inactive":
        rig.levitate()
    run = int(rig.wait_for_state().run)
    rig.wait_for_step(int(rig.wait_for_state().step) + kind.steps)
    kind.cause(session)
    session.wait_until(
        lambda: any((trip.run, trip.reason) == (run, kind.reason) for trip in rig.trips),
        f"the trip of {kind}; there came {[trip.text for trip in rig.trips if trip.run == run]}; {rig.state}",
    )
    if not kind.stays:
        session.wait_until(lambda: rig.life_cycle() == "inactive", "the safe state")
    latched = _refuses(session, kind)
    if not kind.stays:
        kind.repair(session)
    mode = BridgeState.LEVITATED if kind.stays else BridgeState.OFF
    session.wait_until(lambda: _reset(session, mode), "the reset")
    if kind.stays:  # the next trip has a run of its own; a limit can be raised only while the rig is off
        rig.land()
        kind.repair(session)
    return run, latched


def _refuses(session: Session, kind: Kind) -> bool:
    """Whether a trip is latched: what would go on after it is refused with that reason."""
    try:
        if kind.stays:
            session.amb.start_excitation("square", **SQUARE.model_dump() | {"amplitude": 0.5e-6})
        else:
            session.amb.rig.levitate()
    except ClientError as problem:
        return "latched" in str(problem)
    return False


def _recorded(bag: Path) -> dict[tuple[int, int], Any]:
    """Trips of a bag by run and reason."""
    with AnyReader([bag]) as reader:
        wanted = [item for item in reader.connections if item.topic.endswith("/trip")]
        messages: list[Any] = [
            reader.deserialize(data, connection.msgtype) for connection, _, data in reader.messages(wanted)
        ]
    return {(int(message.run), int(message.reason)): message for message in messages}


def _complete(trip: Any, kind: Kind) -> bool:
    """Whether a recorded trip has its axis, and every step of the second before it."""
    return trip.axis == kind.axis and _lacking(trip) == 0


def _lacking(trip: Any) -> int:
    """Steps of the second before a recorded trip, within its run, that it does not have."""
    return min(int(trip.step), BEFORE) - sum(len(block.axes[0].position) for block in trip.before)


def _reset(session: Session, mode: int) -> bool:
    session.amb.rig.reset_faults()
    session.amb.spin_once(0.05)
    state = session.amb.rig.wait_for_state()
    return state.mode == mode and not state.problem


def _set(session: Session, node: str, **values: Any) -> None:
    client = session.amb.node.create_client(SetParameters, f"{node}/set_parameters")
    session.wait_until(client.service_is_ready, f"the node {node}")
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    # The answer to the first request of a new client gets lost where the node has not discovered the client yet.
    pending = PendingRequest(client, SetParameters.Request(parameters=parameters), repeat_after=2.0)
    session.wait_until(lambda: pending.answer() is not None, f"an answer of {node}")
    pending.forget()
    session.amb.node.destroy_client(client)
