"""The 10 kHz loop with simulator and controller in one process: is it faster than real time, with the same samples?"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from domain_coordinator import domain_id

from amb_bringup.client import AmbClient
from amb_core.ground.parameters import load_parameters
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.telemetry import merge_blocks
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.recording.messages.loop_samples import block_from_message, steps_in
from amb_msgs.msg import LoopSamples
from amb_ros.qos import HISTORY

STEPS = 50_000  # 5 s
WARM_UP = 2_000


def measure(steps: int = STEPS) -> dict[str, float | bool]:
    """One bearing: time of a step (us), simulated over wall-clock time for 5 s, and whether the samples are right."""
    with domain_id() as domain:
        return _measure([], PlantParameters(), steps, domain)


def measure_four_axes(steps: int = STEPS) -> dict[str, float | bool]:
    """The same for a rigid rotor in two bearings."""
    file = Path(__file__).with_name("rigid.yaml")
    parameters = load_parameters(PlantParameters, file, "simulator", part=True)
    with domain_id() as domain:
        return _measure(["--ros-args", "--params-file", str(file)], parameters, steps, domain)


def _measure(arguments: list[str], parameters: PlantParameters, steps: int, domain: int) -> dict[str, float | bool]:
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    process = subprocess.Popen([sys.executable, "-m", "amb_bringup.graph.composed_loop", *arguments], env=environment)
    blocks: list[LoopSamples] = []
    try:
        with AmbClient(domain_id=domain) as amb:
            amb.node.create_subscription(LoopSamples, "telemetry", blocks.append, HISTORY)
            amb.reset()
            amb.run(min(WARM_UP, steps))
            run = amb.reset()
            started = time.perf_counter()
            amb.run(steps)
            wall = time.perf_counter() - started
            amb.wait_until(lambda: sum(steps_in(block) for block in blocks if block.run == run) >= steps)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30.0)
    record = merge_blocks([block_from_message(block) for block in blocks if block.run == run], 0, steps)
    plant = Plant(parameters)
    controller = PdController(ControllerParameters(), len(plant.machine.axes))
    return {
        "step_us": wall / steps * 1e6,
        "realtime_factor": steps * record.sample_time / wall,
        "bit_identical": record.identical_to(simulate(plant, controller, steps)),
    }


if __name__ == "__main__":
    print(measure())
