"""What the bridge publishes about itself: the machine, its state, and its diagnostics."""

from __future__ import annotations

import math

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.loop.machine import Machine as MachineDescription
from amb_core.recording.messages.machine import fill_machine
from amb_core.rig.link import Limits, TargetLink
from amb_msgs.msg import BridgeState, Machine, MachineAxis, MachineBearing
from amb_ros import diagnostics, topics
from amb_ros.qos import LATCHED
from amb_sim_node.rig_watch import RigWatch


class RigState:
    """Topics `machine` and `hardware_bridge/state`.

    Parameters
    ----------
    node : Node
        The bridge.
    watch : RigWatch
        What is known of the rig.
    """

    def __init__(self, node: Node, watch: RigWatch) -> None:
        self._node, self._watch = node, watch
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._message = BridgeState(mode=BridgeState.UNREACHABLE)
        self._machine_publisher = node.create_publisher(Machine, topics.MACHINE, LATCHED)
        self._publisher = node.create_publisher(BridgeState, topics.BRIDGE_STATE, LATCHED)

    def publish_machine(self, machine: MachineDescription) -> None:
        """Publish what the target controls."""
        message = fill_machine(Machine(), MachineAxis, MachineBearing, machine)
        message.header.stamp = self._wall_clock.now().to_msg()
        self._machine_publisher.publish(message)

    def publish(self, link: TargetLink | None, *problems: str) -> None:
        """Publish the present state, with every problem that is not empty, once."""
        if not self._node.context.ok():
            return
        watch, message = self._watch, self._message
        with watch.lock:
            status, runs, machine = watch.status, watch.runs, watch.machine
            message.mode = int(status.state) if status is not None and watch.reachable else BridgeState.UNREACHABLE
            if status is not None:
                message.excitation, message.alarm = int(status.excitation), status.alarm
                message.target_step, message.missed = status.step, status.missed
            if runs is not None:
                message.run, message.step, message.position = runs.run, runs.next_step, runs.position.tolist()
                if message.mode == BridgeState.LEVITATED and not runs.levitated:
                    message.mode = BridgeState.LEVITATING  # its run begins with the first telemetry
            if machine is not None:
                message.axes, message.sample_time = list(machine.axis_names), 1.0 / machine.sample_rate
            if link is not None:
                samples = link.count.samples
                message.lost, message.doubled, message.reordered = samples.lost, samples.doubled, samples.reordered
            message.problem = "; ".join(dict.fromkeys(filter(None, problems)))
            message.sequence += 1
            message.header.stamp = self._wall_clock.now().to_msg()
            self._publisher.publish(message)


def report(
    life_cycle: str, watch: RigWatch, link: TargetLink | None, limits: Limits | None, problem: str, warning: str
) -> diagnostics.Report:
    """Diagnostics of the bridge; without a problem, what else is worth a warning, such as samples lost lately."""
    values: dict[str, object] = {"life cycle": life_cycle}
    runs, status = watch.runs, watch.status
    if link is not None:
        count = link.count
        values |= {
            "samples lost": count.samples.lost,
            "samples doubled": count.samples.doubled,
            "blocks reordered": count.samples.reordered,
            "frames refused": count.refused,
            "commands sent again": count.resent,
            "round trip (ms)": _shown(1e3 * count.round_trip),
            "clock of the target (ppm)": _shown(count.clock_drift),
        }
    if watch.known is not None:
        values |= {"firmware": watch.known.firmware, "limits in force": str(limits or "those that the target had")}
    if runs is not None:
        values |= {"run": runs.run, "step": runs.next_step}
    if status is not None:
        values |= {"target": status.state.name, "control steps missed": status.missed}
        values["frames that the target could not send"] = status.unsent
    if problem:
        return diagnostics.ERROR, problem, values
    if link is None:
        return diagnostics.OK, "not configured", values
    if status is not None and status.alarm:
        return diagnostics.WARN, "displacement beyond the alarm share of the clearance", values
    if warning:
        return diagnostics.WARN, warning, values
    return diagnostics.OK, status.state.name.lower() if status is not None else "connected", values


def _shown(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"
