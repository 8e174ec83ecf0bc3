"""A step of the lock-step loop in two processes against a bare ping-pong of the same messages.

The simulator runs in this process, the controller in another; so do ping and pong. Blocks of loop steps and of round
trips alternate, so that both see the same machine. Ping and pong handle messages as the loop does, serialized.
"""

from __future__ import annotations

import itertools
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from domain_coordinator import domain_id
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future
from rclpy.utilities import get_default_context

from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros import middleware
from amb_ros.leaving import leave_graph
from amb_ros.qos import STREAM
from amb_ros.sample_messages import pack_position, unpack_current
from amb_sim_node.simulator import SimulatorNode

ROUNDS, BLOCK = 40, 500  # steps of a block; the first block, which is not counted, warms up
TIMEOUT = 30.0  # s


class Timed:
    """Stands in for the plant and notes when each sample starts and how long it takes."""

    def __init__(self, plant: object) -> None:
        self._plant = plant
        self.starts: list[float] = []
        self.durations: list[float] = []

    def advance(self, currents: Sequence[float]) -> object:
        started = time.perf_counter()
        result = self._plant.advance(currents)
        self.durations.append(time.perf_counter() - started)
        self.starts.append(started)
        return result

    def __getattr__(self, name: str) -> object:
        return getattr(self._plant, name)


class Ping(Node):
    """Sends a position, waits for the current reference of the same step, sends the next."""

    def __init__(self, axes: int) -> None:
        super().__init__("ping", namespace="amb")
        self._position = [1e-6] * axes
        self.starts: list[float] = []
        self._done: Future | None = None
        self._last = 0
        self._step = 0
        self.publisher = self.create_publisher(RotorPosition, "ping", STREAM)
        self.create_subscription(CurrentReference, "pong", self._on_pong, STREAM, raw=True)

    def run(self, round_trips: int) -> Future:
        """Start; the future completes after the last round trip."""
        self._done, self._last = Future(), self._step + round_trips
        self._send()
        return self._done

    def _send(self) -> None:
        self.starts.append(time.perf_counter())
        self.publisher.publish(pack_position(1, self._step, 1e-4 * self._step, self._position))

    def _on_pong(self, data: bytes) -> None:
        _, step, _ = unpack_current(data)
        if step != self._step:
            return
        self._step += 1
        if self._step < self._last:
            self._send()
        else:
            self._done.set_result(None)


def measure(rounds: int = ROUNDS, block: int = BLOCK) -> dict[str, float | bool]:
    """One bearing, medians in us: step, plant within the step, bare round trip; and (step - plant) / round trip."""
    with domain_id() as domain:
        return _measure([], rounds, block, domain)


def measure_four_axes(rounds: int = ROUNDS, block: int = BLOCK) -> dict[str, float | bool]:
    """The same for a rigid rotor in two bearings, with round trips of messages for four axes."""
    arguments = ["--ros-args", "--params-file", str(Path(__file__).with_name("rigid.yaml"))]
    with domain_id() as domain:
        return _measure(arguments, rounds, block, domain)


def _measure(arguments: list[str], rounds: int, block: int, domain: int) -> dict[str, float | bool]:
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}
    pong = [sys.executable, str(Path(__file__).with_name("pong.py"))]
    middleware.configure()
    rclpy.init(args=arguments, domain_id=domain)
    children = [
        subprocess.Popen(command, env=environment)
        for command in ([sys.executable, "-m", "amb_controller_node.pd_controller"], pong)
    ]
    executor = EventsExecutor()
    simulator = SimulatorNode()
    ping = Ping(len(simulator._plant.machine.axes))
    try:
        executor.add_node(simulator)
        executor.add_node(ping)
        _wait_for_peers(executor, simulator, ping)
        timed = simulator._plant = Timed(simulator._plant)
        steps, round_trips, plant = [], [], []
        for number in range(rounds + 1):
            for starts in (timed.starts, timed.durations, ping.starts):
                starts.clear()
            _run_loop(executor, simulator, block)
            _spin_until(executor, ping.run(block))
            if number > 0:
                steps += _differences(timed.starts)
                plant += timed.durations
                round_trips += _differences(ping.starts)
    finally:
        for child in children:
            child.send_signal(signal.SIGINT)
        for child in children:
            child.wait(TIMEOUT)
        leave_graph(get_default_context(), executor, [simulator, ping])
        rclpy.try_shutdown()  # forgets the context: the next measurement has one of its own
    step_us, plant_us, floor_us = (1e6 * statistics.median(times) for times in (steps, plant, round_trips))
    return {
        "ratio": (step_us - plant_us) / floor_us,
        "step_us": step_us,
        "plant_us": plant_us,
        "floor_us": floor_us,
    }


def _run_loop(executor: rclpy.executors.Executor, simulator: SimulatorNode, steps: int) -> None:
    last = simulator._state.step + steps
    simulator._start(steps)
    while simulator._state.step < last:
        executor.spin_until_future_complete(Future(), timeout_sec=0.02)


def _spin_until(executor: rclpy.executors.Executor, future: Future) -> None:
    while not future.done():
        executor.spin_until_future_complete(future, timeout_sec=0.5)


def _wait_for_peers(executor: rclpy.executors.Executor, simulator: SimulatorNode, ping: Ping) -> None:
    deadline = time.monotonic() + TIMEOUT
    subscriptions = [simulator._current_subscription, *ping.subscriptions]
    publishers = [simulator._position_publisher, ping.publisher]
    while not (
        all(publisher.get_subscription_count() for publisher in publishers)
        and all(subscription.get_publisher_count() for subscription in subscriptions)
    ):
        if time.monotonic() > deadline:
            raise TimeoutError("controller and pong did not appear")
        executor.spin_once(timeout_sec=0.05)


def _differences(times: list[float]) -> list[float]:
    return [later - earlier for earlier, later in itertools.pairwise(times)]


if __name__ == "__main__":
    print(measure())
