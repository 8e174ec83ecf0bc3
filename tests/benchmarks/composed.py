"""The 10 kHz loop with simulator and controller in one process: is it faster than real time, with the same samples?"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from amb_bringup.client import AmbClient
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.telemetry import merge_blocks
from amb_core.parameters import load_parameters
from amb_core.plant import Plant, PlantParameters
from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_core.simulation import simulate
from amb_msgs.msg import LoopSamples
from amb_ros.qos import HISTORY

STEPS = 50_000  # 5 s
WARM_UP = 2_000
DOMAIN = 94


def measure() -> dict[str, float | bool]:
    """One bearing: time of a step (us), simulated over wall-clock time for 5 s, and whether the samples are right."""
    return _measure([], PlantParameters())


def measure_four_axes() -> dict[str, float | bool]:
    """The same for a rigid rotor in two bearings."""
    file = Path(__file__).with_name("rigid.yaml")
    return _measure(
        ["--ros-args", "--params-file", str(file)], load_parameters(PlantParameters, file, "simulator", part=True)
    )


def _measure(arguments: list[str], parameters: PlantParameters) -> dict[str, float | bool]:
    environment = os.environ | {"ROS_DOMAIN_ID": str(DOMAIN)}
    process = subprocess.Popen([sys.executable, "-m", "amb_bringup.composed_loop", *arguments], env=environment)
    blocks: list[LoopSamples] = []
    try:
        with AmbClient(domain_id=DOMAIN) as amb:
            amb.node.create_subscription(LoopSamples, "telemetry", blocks.append, HISTORY)
            amb.reset()
            amb.run(WARM_UP)
            run = amb.reset()
            started = time.perf_counter()
            amb.run(STEPS)
            wall = time.perf_counter() - started
            amb.wait_until(lambda: sum(steps_in(block) for block in blocks if block.run == run) >= STEPS)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30.0)
    record = merge_blocks([block_from_message(block) for block in blocks if block.run == run], 0, STEPS)
    plant = Plant(parameters)
    controller = PdController(ControllerParameters(), len(plant.machine.axes))
    return {
        "step_us": wall / STEPS * 1e6,
        "realtime_factor": STEPS * record.sample_time / wall,
        "bit_identical": record.identical_to(simulate(plant, controller, STEPS)),
    }


if __name__ == "__main__":
    print(measure())
