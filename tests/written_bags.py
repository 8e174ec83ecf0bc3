"""Bags that tests write message by message: blocks of telemetry, answers to excitations, states of a plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from amb_core.recording import BagWriter
from tests.bag_messages import TYPES, definition

LOOP_SAMPLES = "amb_msgs/msg/LoopSamples"
PLANT_STATE = "amb_msgs/msg/PlantState"
STATUS = "amb_msgs/msg/ExcitationStatus"
EVENT = "rcl_interfaces/msg/ParameterEvent"
BLOCK = 100
SIGNALS = ("reference_x", "reference_y", "position_x", "position_y", "current_x", "current_y")


def serialize(message: Any) -> bytes:
    return bytes(TYPES.serialize_cdr(message, message.__msgtype__))


def signal(name: str, steps: np.ndarray) -> np.ndarray:
    """Samples that tell every step and signal apart."""
    return np.sin(1e-3 * steps) + SIGNALS.index(name)


def block(run: int, first_step: int, steps: int = BLOCK) -> bytes:
    time = TYPES.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = TYPES.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    index = np.arange(first_step, first_step + steps)
    axes = [
        TYPES.types["amb_msgs/msg/AxisSamples"](
            name=axis, **{name: signal(f"{name}_{axis}", index) for name in ("reference", "position", "current")}
        )
        for axis in "xy"
    ]
    return serialize(
        TYPES.types[LOOP_SAMPLES](header=header, run=run, first_step=first_step, sample_time=1e-4, axes=axes)
    )


def status(run: int, first_step: int, steps: int, accepted: bool = True, kind: str = "square") -> bytes:
    return serialize(
        TYPES.types[STATUS](run=run, id=1, kind=kind, accepted=accepted, message="", first_step=first_step, steps=steps)
    )


def plant_state(run: int, step: int, coil_currents: int = 8) -> bytes:
    """Of a rotor in two bearings; every number tells its step, bearing and place."""
    stamp = TYPES.types["builtin_interfaces/msg/Time"](sec=step // 10_000, nanosec=step % 10_000 * 100_000)
    pair = step + np.arange(2.0)
    return serialize(
        TYPES.types[PLANT_STATE](
            header=TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
            run=run,
            step=step,
            coil_current=step + 0.1 * np.arange(coil_currents),
            flux_density=step + 0.01 * np.arange(16),
            force_x=pair,
            force_y=-pair,
            position_x=1e-6 * pair,
            position_y=-1e-6 * pair,
            contact=np.array([False, True]),
            contact_force=2.0 * pair,
        )
    )


def write_telemetry(folder: Path, blocks: list[tuple[int, int]], chunk_age: float = 60.0) -> Path:
    """A bag of telemetry blocks (run, first step), one chunk for every ten of them."""
    with BagWriter(folder, chunk_age) as bag:
        bag.add_topic("/amb/telemetry", LOOP_SAMPLES, definition(LOOP_SAMPLES))
        for number, (run, first_step) in enumerate(blocks):
            bag.write("/amb/telemetry", block(run, first_step), 10**9 + 10**7 * number)
            if number % 10 == 9:
                bag.flush()
    return folder
