"""Names of the modes of the simulator, in logs, diagnostics and pages."""

from __future__ import annotations

from amb_msgs.msg import SimulatorState

MODE_NAMES = {
    SimulatorState.PAUSED: "paused",
    SimulatorState.RUNNING: "running",
    SimulatorState.WAITING: "waiting for the controller",
    SimulatorState.DELEVITATED: "delevitated",
    SimulatorState.FAULT: "fault",
}
