"""Node `hardware_bridge`: a rig on the topics of the workbench, through a real-time target that closes the loop.

A managed node. Configure: connect, check and set the target. Activate: levitate. Deactivate: land. It publishes the
machine and telemetry, and takes excitations, as simulator and controller do together; a run begins with a levitation.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from concurrent.futures import TimeoutError as NotInTime
from dataclasses import replace
from functools import partial

from rclpy.clock import Clock, ClockType
from std_srvs.srv import Trigger

from amb_core.errors import AmbError, TargetError, one_line
from amb_core.loop.machine import Machine as MachineDescription
from amb_core.loop.real_time import enter_real_time
from amb_core.recording.messages.loop_samples import fill_loop_samples
from amb_core.recording.messages.machine import fill_machine
from amb_core.rig import BridgeTrip, ExcitationProtection, Runs, RunSamples, TripLog, describe
from amb_core.rig.trips import axis_of
from amb_core.target import (
    TargetDescription,
    TargetLink,
    TargetSettings,
    TargetState,
    TargetStatus,
    TelemetryBlock,
    Trip,
)
from amb_msgs.msg import AxisSamples, BridgeState, LoopSamples, Machine, MachineAxis, MachineBearing
from amb_msgs.msg import Trip as TripMessage
from amb_ros import diagnostics, topics
from amb_ros.managed_node import ManagedNode
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED
from amb_ros.services import create_service
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.gains import gains_in
from amb_sim_node.region_guard import guard_of
from amb_sim_node.rig_excitation import Rig, RigExcitation
from amb_sim_node.rig_link import controller_of, link_of

STATE_PERIOD = 0.1  # s between messages on the state, and without samples until a partial block is published
PATIENCE = 5.0  # s in addition to its duration for a levitation or a landing


class HardwareBridgeNode(ManagedNode):
    """The bridge. Topics, services and parameters: see the package's README.

    Parameters
    ----------
    arguments : list of str
        Of the process: gains that the bridge is not given come from the block of pd_controller in its parameter file.

    Raises
    ------
    AmbError
        If a parameter is wrong.
    """

    def __init__(self, arguments: list[str]) -> None:
        super().__init__(
            "hardware_bridge", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        for name, value in gains_in(arguments, self.get_namespace()).items():
            if not self.has_parameter(name):
                self.declare_parameter(name, value)
        self._settings = declare(self, BridgeParameters, self._on_parameters)
        self._lock = threading.RLock()  # samples and trips: thread of the link, executor and worker
        self._link: TargetLink | None = None
        self._machine: MachineDescription | None = None
        self._known: TargetDescription | None = None
        self._ready: Rig | None = None  # while configured
        self._excitable = False  # while active
        self._runs: Runs | None = None
        self._status: TargetStatus | None = None
        self._reachable = False
        self._trips = TripLog()
        self._own_trips: list[Trip] = []  # latched by the bridge itself
        self._unsent = ""  # why the target does not have the settings; empty: it has them
        self._flushed = 0  # step of the target
        self._run = 0
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._state_message = BridgeState(mode=BridgeState.UNREACHABLE)
        self._machine_publisher = self.create_publisher(Machine, topics.MACHINE, LATCHED)
        self._telemetry_publisher = self.create_publisher(LoopSamples, topics.TELEMETRY, HISTORY)
        self._state_publisher = self.create_publisher(BridgeState, topics.BRIDGE_STATE, LATCHED)
        self._trip_publisher = self.create_publisher(TripMessage, topics.TRIP, EVERY_STATE)
        self._excitation = RigExcitation(self, lambda: self._ready if self._excitable else None)
        create_service(self, Trigger, "~/reset_faults", self._on_reset_faults, self.worker)
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.MACHINE, topics.TELEMETRY, topics.BRIDGE_STATE)
        )
        self._timer = self.create_timer(STATE_PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """Land if the bridge is active and its parameters say so; leave the target and end the node."""
        self._excitation.close()
        try:
            self.worker.submit(self._leave).result(self._settings.landing_time + 2.0 * PATIENCE)
        except NotInTime:
            self.get_logger().error("the worker does not end; the target is left as it is")
        self.worker.shutdown(wait=False, cancel_futures=True)
        super().destroy_node()

    def _leave(self) -> None:
        try:
            if self.state_label == "active" and self._settings.at_exit == "land":
                self.deactivate()
        except AmbError as problem:
            self.get_logger().error(str(problem))
        self.clean_up()

    # -- transitions, in the worker

    def configure(self) -> None:
        """Connect to the target, check it and send it controller, limits and references."""
        settings = self._settings
        guard = guard_of(settings, controller_of(settings))
        link = link_of(settings.link, self._enter_real_time)
        try:
            description = link.connect(self)
            machine, wanted = description.machine, self._wanted(description)
            link.configure(wanted)
            protection = self._protection(description, wanted)
            with self._lock:
                self._known, self._machine, self._link, self._reachable = description, machine, link, True
                self._runs = Runs(machine, settings.telemetry_block, self._new_run)
                self._trips, self._own_trips, self._unsent = TripLog(), [], ""
        except Exception:
            link.close()
            raise
        self._publish_machine(machine)
        self._ready = Rig(link, machine, self._runs, protection, guard)
        self.get_logger().info(
            f"machine {machine.name!r}, axes {', '.join(machine.axis_names)}, {machine.sample_rate:g} Hz, firmware "
            f"{description.firmware}"
        )
        self._note_state()

    def activate(self) -> None:
        """Levitate. A rotor that is levitated already, since an earlier bridge left it so, stays as it is."""
        link = self._connected()
        status = link.status()
        self._require_same_machine()
        if self._latched():
            raise TargetError("trips are latched; reset the faults first")
        if self._unsent:
            self._send(link)
        if status.state in (TargetState.OFF, TargetState.LANDING):
            self._wait_for((TargetState.OFF,), self._settings.landing_time)
            link.levitate(self._settings.levitation_time)
            self._wait_for((TargetState.LEVITATED,), self._settings.levitation_time)
        self._wait_for_run()
        self._excitable = True
        self._note_state()

    def deactivate(self) -> None:
        """Stop the excitation and land; nothing to do if protection has switched off."""
        self._excitable = False
        self._excitation.call_off()
        link = self._connected()
        if self._reachable and link.status().state in (TargetState.LEVITATING, TargetState.LEVITATED):
            link.land(self._settings.landing_time)
        if self._reachable:
            self._wait_for((TargetState.OFF, TargetState.TRIPPED), self._settings.landing_time)
        self._note_state()

    def clean_up(self) -> None:
        """Leave the target as it is."""
        self._excitable = False
        link, self._link = self._link, None
        if link is not None:
            link.close()
        with self._lock:
            self._publish(self._runs.end() if self._runs is not None else [])
            self._runs, self._status, self._reachable, self._unsent = None, None, False, ""
        self._note_state()

    def _enter_real_time(self) -> None:
        """In the thread of the link, when it starts."""
        if problem := enter_real_time(self._settings.real_time):
            self.get_logger().warning(problem)

    def _connected(self) -> TargetLink:
        if self._link is None:
            raise TargetError("the bridge is not configured")
        return self._link

    def _require_same_machine(self) -> None:
        """Raise TargetError if the target is another machine since its reboot."""
        if self._known is not None and self._known.machine != self._machine:
            raise TargetError("the target is another machine since its reboot; clean up and configure again")

    def _wanted(self, description: TargetDescription) -> TargetSettings:
        """What the parameters ask of a target.

        Raises
        ------
        ParameterError
            If they contradict each other, or the file of a controller cannot be read.
        """
        settings = self._settings
        limits = settings.protection.lowered(description.limits, settings.current_limit)
        return TargetSettings(controller_of(settings), limits, settings.landing_reference)

    def _protection(self, description: TargetDescription, wanted: TargetSettings) -> ExcitationProtection:
        """What excitations of this target are checked against."""
        machine = description.machine
        return ExcitationProtection(
            self._settings.protection,
            wanted.limits,
            machine.axis_names,
            machine.sample_rate,
            description.waveform_steps,
        )

    def _wait_for_run(self) -> None:
        """Wait until telemetry of the levitated rotor arrives: the run has begun."""
        until = time.monotonic() + PATIENCE
        while self._runs is None or not self._runs.levitated:
            if time.monotonic() > until:
                raise TargetError(f"the rotor is levitated, but no telemetry arrives within {PATIENCE:g} s")
            time.sleep(0.002)

    def _wait_for(self, states: tuple[TargetState, ...], duration: float) -> None:
        """Wait until the target is in one of some states.

        Raises
        ------
        TargetError
            If it trips instead, or takes much longer than it should (s).
        """
        until = time.monotonic() + duration + PATIENCE
        while (status := self._connected().status()).state not in states:
            if status.state is TargetState.TRIPPED:
                raise TargetError(self._latched() or "the target has tripped")
            if time.monotonic() > until:
                raise TargetError(f"the target is still {status.state.name.lower()} after {duration + PATIENCE:g} s")
            time.sleep(0.01)

    # -- the link, in its thread

    def on_samples(self, block: TelemetryBlock) -> None:
        """Publish what has arrived, and the trips up to there."""
        with self._lock:
            if self._runs is None or self._known is None or self._known.machine != self._machine:
                return  # not configured; or of another machine, see `_require_same_machine`
            before = self._runs.levitated
            self._publish(self._runs.add(block))
            changed = before != self._runs.levitated
        self._publish_trips()
        if changed:
            self._note_state()

    def on_status(self, status: TargetStatus) -> None:
        """Note the state of the target and new trips."""
        with self._lock:
            former, self._status, self._reachable = self._status, status, True
            tripped = self._trips.note(status, time.monotonic())
        self._publish_trips()
        if former is None or tripped or (former.state, former.excitation) != (status.state, status.excitation):
            self._note_state()
        if tripped and status.state is TargetState.TRIPPED:
            self._excitable = False
            self.fall_back()

    def on_silence(self) -> None:
        """The target does not answer: latched, since nobody knows what the rotor does."""
        self._reachable = False
        self._trip_by_itself(BridgeTrip.LINK_LOST)

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        """The target answers again. A reboot ends the run; what the target has forgotten is sent again."""
        self._reachable = True
        if not rebooted:
            self._note_state()
            return
        with self._lock:
            if self._runs is not None:
                self._publish(self._runs.end())
            self._known, self._trips = description, TripLog()
            self._unsent = "the target has not got its settings since its reboot"
        self._excitable = False
        self._trip_by_itself(BridgeTrip.REBOOT)
        self.fall_back()
        self.worker.submit(self._send_settings)

    def _send_settings(self) -> None:
        """Send controller, limits and references again; a refusal is part of the state until they are taken."""
        if self._link is None:
            return
        try:
            self._send(self._link)
        except AmbError as problem:
            self._unsent = one_line(problem)
            self.get_logger().error(f"the target has not taken the settings: {problem}")
        self._note_state()

    def _send(self, link: TargetLink) -> None:
        self._require_same_machine()
        assert self._known is not None and self._ready is not None  # since it is configured
        wanted = self._wanted(self._known)
        link.configure(wanted)
        self._ready = replace(self._ready, protection=self._protection(self._known, wanted))
        self._unsent = ""

    # -- trips

    def _trip_by_itself(self, reason: BridgeTrip) -> None:
        with self._lock:
            step = self._runs.next_target_step if self._runs is not None else 0
            trip = Trip(reason, step, 0, 0.0)  # type: ignore[arg-type]
            self._own_trips.append(trip)
        self._publish_trip(trip)
        self._note_state()

    def _publish_trips(self) -> None:
        """Publish the trips up to which telemetry has arrived."""
        with self._lock:
            step = self._runs.next_target_step if self._runs is not None else 0
            ready = self._trips.ready(step, time.monotonic())
        for trip in ready:
            self._publish_trip(trip)

    def _publish_trip(self, trip: Trip) -> None:
        machine, runs = self._machine, self._runs
        if machine is None or runs is None or not self.context.ok():
            return
        with self._lock:
            before = runs.before(trip.step)
            step, within = runs.step_of(trip.step), runs.holds(trip.step)
        message = TripMessage(target_step=trip.step, reason=int(trip.reason), value=float(trip.value))
        message.axis = axis_of(trip, machine)
        if within:
            message.run, message.step = runs.run, step
            message.before = [fill_loop_samples(LoopSamples(), AxisSamples, runs.run, record) for record in before]
        where = f"step {step} of run {runs.run}" if message.run else f"step {trip.step} of the target, outside of runs"
        message.text = f"{describe(trip, machine)}, at {where}"
        message.header.stamp = self._wall_clock.now().to_msg()
        self._trip_publisher.publish(message)
        self.get_logger().error(message.text)

    def _latched(self) -> str:
        """All latched trips as text."""
        machine = self._machine
        if machine is None:
            return ""
        with self._lock:
            return "; ".join(describe(trip, machine) for trip in (*self._trips.latched, *self._own_trips))

    def _on_reset_faults(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        link = self._connected()
        link.reset_faults()
        with self._lock:
            self._own_trips.clear()
        self.problem = ""
        self.on_status(link.status())
        response.success = True
        self._note_state()
        return response

    # -- topics

    def _new_run(self) -> int:
        self._run = max(self._run + 1, self._wall_clock.now().nanoseconds // 1000)
        return self._run

    def _publish_machine(self, machine: MachineDescription) -> None:
        message = fill_machine(Machine(), MachineAxis, MachineBearing, machine)
        message.header.stamp = self._wall_clock.now().to_msg()
        self._machine_publisher.publish(message)

    def _publish(self, blocks: list[RunSamples]) -> None:
        if self.context.ok():
            for block in blocks:
                self._telemetry_publisher.publish(
                    fill_loop_samples(LoopSamples(), AxisSamples, block.run, block.record)
                )

    def _on_timer(self) -> None:
        """Publish the state, and a partial block if no sample has come since the last call."""
        with self._lock:
            if self._runs is not None:
                if self._runs.next_target_step == self._flushed:
                    self._publish(self._runs.flush())
                self._flushed = self._runs.next_target_step
        self._publish_trips()
        self._note_state()

    def _note_state(self) -> None:
        """Publish the present state."""
        if not self.context.ok():
            return
        with self._lock:
            message, status, runs, machine = self._state_message, self._status, self._runs, self._machine
            message.mode = int(status.state) if status is not None and self._reachable else BridgeState.UNREACHABLE
            if status is not None:
                message.excitation, message.alarm = int(status.excitation), status.alarm
                message.target_step, message.missed = status.step, status.missed
            if runs is not None:
                message.run, message.step, message.position = runs.run, runs.next_step, runs.position.tolist()
                if message.mode == BridgeState.LEVITATED and not runs.levitated:
                    message.mode = BridgeState.LEVITATING  # its run begins with the first telemetry
            if machine is not None:
                message.axes, message.sample_time = list(machine.axis_names), 1.0 / machine.sample_rate
            if self._link is not None:
                samples = self._link.count.samples
                message.lost, message.doubled, message.reordered = samples.lost, samples.doubled, samples.reordered
            message.problem = "; ".join(dict.fromkeys(filter(None, (self._latched(), self._unsent, self.problem))))
            message.sequence += 1
            message.header.stamp = self._wall_clock.now().to_msg()
            self._state_publisher.publish(message)

    # -- parameters and health

    def _on_parameters(self, parameters: BridgeParameters) -> None:
        self._settings = parameters
        self.worker.submit(self._send_settings)

    def _report(self) -> diagnostics.Report:
        values: dict[str, object] = {"life cycle": self.state_label}
        link, runs, status = self._link, self._runs, self._status
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
        if known := self._known:
            limits = self._settings.protection.lowered(known.limits, self._settings.current_limit)
            values |= {"firmware": known.firmware, "limits in force": str(limits)}
        if runs is not None:
            values |= {"run": runs.run, "step": runs.next_step}
        if status is not None:
            values |= {"target": status.state.name, "control steps missed": status.missed}
            values["frames that the target could not send"] = status.unsent
        if problem := self._latched() or self._unsent or self.problem:
            return diagnostics.ERROR, problem, values
        if link is None:
            return diagnostics.OK, "not configured", values
        if status is not None and status.alarm:
            return diagnostics.WARN, "displacement beyond the alarm share of the clearance", values
        if link.count.samples.lost:
            return diagnostics.WARN, f"{link.count.samples.lost} samples of telemetry lost", values
        return diagnostics.OK, status.state.name.lower() if status is not None else "connected", values


def _shown(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(partial(HardwareBridgeNode, args or sys.argv), args)


if __name__ == "__main__":
    raise SystemExit(main())
