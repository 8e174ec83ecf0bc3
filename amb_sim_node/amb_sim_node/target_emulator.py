"""Node `target_emulator`: a rig without hardware. The C target runs around the plant behind a UDP socket.

The target runs in a process of its own (`amb_core.rig.emulation.process`). The node has its parameters, a service that
boots it, and its diagnostics. It has no topics of the loop: hosts reach it by AMB-UDP, as they reach a rig.
"""

from __future__ import annotations

import sys
from functools import partial

from rclpy.node import Node
from std_srvs.srv import Trigger

from amb_core.ground.errors import TargetError
from amb_core.plant.machine import machine_of
from amb_core.rig.emulation import Address, EmulatorProcess, EmulatorReport, EmulatorSettings, as_on_a_rig
from amb_core.rig.emulation.faulty_coils import FaultyCoils
from amb_core.rig.emulation.faulty_sensors import faulty_axes
from amb_core.rig.emulation.load import ENOUGH
from amb_core.rig.link.key_file import read_key
from amb_ros import diagnostics, topics
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.services import create_service
from amb_sim_node.emulator_parameters import TargetEmulatorParameters
from amb_sim_node.emulator_values import emulator_values, trips_text
from amb_sim_node.machine_files import machine_file, machine_parameters


class TargetEmulatorNode(Node):
    """The target emulator. Service, parameters and limits: see the package's README.

    Parameters
    ----------
    arguments : list of str
        Of the process, for the parameter file with which it was started.

    Raises
    ------
    AmbError
        If a parameter is wrong, or the emulator cannot start.
    """

    def __init__(self, arguments: list[str]) -> None:
        super().__init__(
            "target_emulator", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        self._arguments = arguments
        self._emulator: EmulatorProcess | None = None
        settings = declare(self, TargetEmulatorParameters, self._on_change, self._check)
        key = read_key(settings.key_file) if settings.key_file else b""
        self._emulator = EmulatorProcess(
            EmulatorSettings(
                self._plant,
                self._controller,
                settings.limits,
                settings.faults,
                Address(settings.address, settings.port, key),
                settings.block_steps,
                settings.real_time_factor,
                settings.real_time,
                settings.host_patience,
                settings.plant_waits,
            )
        )
        self._ended = self._logged = ""
        self._missed = 0  # deadlines, at the last report
        self._announce(settings, self._emulator)
        create_service(self, Trigger, "~/reboot", self._on_reboot)
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report)

    def finish(self) -> None:
        """End the emulator."""
        if self._emulator is not None:
            self._emulator.close()

    def _check(self, settings: TargetEmulatorParameters) -> None:
        """Refuse faults of axes that the machine lacks; the machine is read once, before the emulator starts."""
        if self._emulator is None:
            namespace = self.get_namespace()
            self._file = machine_file(settings.parameter_file, self._arguments, namespace)
            self._plant, self._controller = machine_parameters(self._file, namespace)
            if not settings.ideal:
                self._plant = as_on_a_rig(self._plant)
            self._axes = machine_of(self._plant).axis_names
        faulty_axes(settings.faults.sensor, self._axes)
        FaultyCoils(self._axes, settings.faults.coil, 1.0)

    def _on_change(self, settings: TargetEmulatorParameters) -> None:
        if self._emulator is not None:
            self._emulator.configure(settings.faults)

    def _on_reboot(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        assert self._emulator is not None
        response.message = f"boot {self._emulator.reboot().boots} since the start of the node"
        response.success = True
        return response

    def _announce(self, settings: TargetEmulatorParameters, emulator: EmulatorProcess) -> None:
        """Log what is emulated, and what does not go as it should."""
        logger, started = self.get_logger(), emulator.started
        source = f"the machine of {self._file}" if self._file else "the machine of the default parameters"
        logger.info(f"{source}, axes {', '.join(self._axes)}, on {started.where}")
        if started.load.share > ENOUGH:
            logger.warning(str(started.load))
        else:
            logger.info(str(started.load))
        if started.load.still and settings.limits.stuck_time > 0.0:
            logger.warning(
                f"the sensors of {', '.join(started.load.still)} show the same position bit for bit, so the target "
                "will trip (SENSOR_STUCK); set sensor.noise of the simulator, or limits.stuck_time: 0.0"
            )
        if started.not_real_time:
            logger.warning(started.not_real_time)

    def _report(self) -> diagnostics.Report:
        assert self._emulator is not None
        if not self._ended:
            try:
                self._emulator.ask_for_report()
            except TargetError as problem:
                self._ended = str(problem)
                self.get_logger().error(self._ended)
        report = self._emulator.latest
        values = emulator_values(self._emulator.started.port, report)
        if self._ended:
            return diagnostics.ERROR, self._ended, values
        self._log_trips(report)
        missed, self._missed = self._missed, report.pace.missed if report.pace is not None else 0
        if trips := trips_text(report):
            return diagnostics.WARN, f"tripped: {trips}", values
        if self._missed > missed:
            return diagnostics.WARN, f"{self._missed - missed} deadlines missed since the last report", values
        return diagnostics.OK, f"amplifiers {'on' if report.enabled else 'off'}", values

    def _log_trips(self, report: EmulatorReport) -> None:
        """Log trips once, with what happened to the plant."""
        text = trips_text(report)
        if text and text != self._logged:
            cause = f"; the plant: {report.trouble}" if report.trouble else ""
            self.get_logger().warning(f"the target tripped: {text}{cause}")
        self._logged = text


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(partial(TargetEmulatorNode, sys.argv if args is None else args), args)


if __name__ == "__main__":
    raise SystemExit(main())
