"""A process that publishes a machine of four axes and its telemetry in real time, as a bridge to a rig does.

The samples are those of the simulated closed loop under a periodic multisine on all axes, its last period repeated.
"""

from __future__ import annotations

import signal
import time
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from amb_bringup.demos.demo_run import controller_of, plant_of, samples_of
from amb_core.excitation import Multisine
from amb_core.loop.control import PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant.simulation import simulate
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.recording.messages.machine import fill_machine
from amb_msgs.msg import AxisSamples, LoopSamples, Machine, MachineAxis, MachineBearing
from amb_ros import middleware
from amb_ros.diagnostics import OK, DiagnosticsReporter
from amb_ros.qos import HISTORY, LATCHED

PARAMETERS = Path(__file__).parents[1] / "rigid.yaml"  # four axes
BLOCK = 100  # steps, as controllers and bridge publish them
PERIOD = 5_000  # steps
PERIODS = 3
EXCITATION = Multisine(
    amplitude=5e-6, axes="all", duration=PERIODS * PERIOD * 1e-4, periods=PERIODS, frequency_end=1000.0
)


def record() -> tuple[LoopRecord, Machine]:
    """A period of the steady state, and the machine."""
    plant = plant_of(PARAMETERS)
    controller = PdController(controller_of(PARAMETERS), len(plant.machine.axes))
    run = simulate(plant, controller, PERIODS * PERIOD, samples_of(EXCITATION, plant.machine))
    return run.window((PERIODS - 1) * PERIOD, PERIOD), fill_machine(
        Machine(), MachineAxis, MachineBearing, plant.machine
    )


def main() -> None:
    """Publish until SIGINT or SIGTERM."""
    ended: list[bool] = []
    period, machine = record()
    middleware.configure()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(True))
    node = Node("player", namespace="amb")
    node.create_publisher(Machine, "machine", LATCHED).publish(machine)
    publisher = node.create_publisher(LoopSamples, "telemetry", HISTORY)
    reporter = DiagnosticsReporter(node, lambda: (OK, "playing", {}))
    messages = [
        fill_loop_samples(LoopSamples(), AxisSamples, time.time_ns() // 1000, period.window(first, BLOCK))
        for first in range(period.first_step, period.first_step + PERIOD, BLOCK)
    ]
    run, begin, number = messages[0].run, time.monotonic(), 0
    while not ended:
        number += 1
        time.sleep(max(0.0, begin + number * BLOCK * period.sample_time - time.monotonic()))
        message = messages[number % len(messages)]
        message.run, message.first_step = run, number * BLOCK
        publisher.publish(message)
        if number % 50 == 0:
            reporter.publish()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
