"""Node `hardware_bridge`: a rig on the topics of the workbench, through a real-time target that closes the loop.

A managed node. Configure: connect, check and set the target. Activate: levitate. Deactivate: land. It publishes the
machine and telemetry, and takes excitations, as simulator and controller do together; a run begins with a levitation.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as NotInTime
from dataclasses import replace
from functools import partial
from threading import Lock

import numpy as np
from rclpy.clock import Clock, ClockType
from std_srvs.srv import Trigger

from amb_core.ground.errors import AmbError, TargetError, one_line
from amb_core.ground.parameters import flatten
from amb_core.loop.real_time import enter_real_time
from amb_core.rig import ExcitationProtection
from amb_core.rig.link import (
    HostLoopLink,
    TargetDescription,
    TargetLink,
    TargetSettings,
    TargetState,
    TargetStatus,
)
from amb_ros import diagnostics, network, topics
from amb_ros.managed_node import CalledOffError, ManagedNode
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.services import create_service
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.gains import gains_in
from amb_sim_node.region_guard import guard_of
from amb_sim_node.rig_excitation import Rig, RigExcitation
from amb_sim_node.rig_host_loop import HostLoop
from amb_sim_node.rig_link import controller_of, link_of, require_host_loop, switch_off
from amb_sim_node.rig_losses import RecentLosses
from amb_sim_node.rig_state import RigState, report
from amb_sim_node.rig_waits import PATIENCE, STANDS_STILL, RigWaits
from amb_sim_node.rig_watch import OFF, Reactions, RigWatch

STATE_PERIOD = 0.1  # s between messages on the state, and without samples until a partial block is published
SETTINGS_WAIT = "the target keeps the settings that it had until the rotor has landed"


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
        self._start: BridgeParameters | None = None  # what the operator gave; later changes come from anybody
        self._settings = self._start = declare(self, BridgeParameters, self._on_parameters, self._check_parameters)
        self._open_sockets = network.sockets_open_to_network(self.context.get_domain_id())
        if self._open_sockets:
            self.get_logger().warning(self._reach())
        self._link: TargetLink | None = None
        self._ready: Rig | None = None  # while configured
        self._excitable = False  # while active
        self._unsent = ""  # why the target does not have the settings; empty: it has them
        self._lifting = Lock()  # held from a look at what is wanted, or at the rotor, until it is lifted or landed
        self._losses = RecentLosses()
        self._host_loop: HostLoop | None = None
        self._excitation: RigExcitation | None = None
        if self._settings.mode == "host":
            self._host_loop, sampled = HostLoop(self, self._link_of_host_loop), topics.POSITION
        else:
            self._excitation = RigExcitation(self, lambda: self._ready if self._excitable else None)
            sampled = topics.TELEMETRY
        reactions = Reactions(
            self._note_state, self._on_stopped, self._on_switched_off, self._on_rebooted, self._connected
        )
        self._watch = RigWatch(self, reactions, self._host_loop)
        self._waits = RigWaits(self._watch, self._connected)
        self._state = RigState(self, self._watch)
        create_service(self, Trigger, "~/reset_faults", self._on_reset_faults, self.worker)
        self._at_once = ThreadPoolExecutor(1, thread_name_prefix="off")  # does not wait for a transition
        create_service(self, Trigger, "~/off", self._on_off, self._at_once)
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.MACHINE, sampled, topics.BRIDGE_STATE)
        )
        self._timer = self.create_timer(STATE_PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def let_go(self) -> None:
        """Where a controller node closes the loop, land while it still does: the target lands by its own PD law."""
        link, host = self._link, self._host_loop is not None
        if not host or link is None or self.state_label != "active":
            return
        self.called_off.set()
        try:
            self._land(link)
        except AmbError as problem:
            self.get_logger().error(one_line(problem))

    def finish(self) -> None:
        """Land if the bridge is active and its parameters say so; leave the target."""
        self.called_off.set()
        if self._excitation is not None:
            self._excitation.close()
        try:
            self.worker.submit(self._leave).result(self._settings.landing_time + 2.0 * PATIENCE)
        except NotInTime:
            self.get_logger().error("the worker does not end; the target is left as it is")
        self._watch.close()
        for worker in (self.worker, self._at_once):
            worker.shutdown(wait=False, cancel_futures=True)

    def _leave(self) -> None:
        try:
            if self.state_label == "active" and self._settings.at_exit == "land":
                self.deactivate()
        except AmbError as problem:
            self.get_logger().error(one_line(problem))
        self.clean_up()

    # -- transitions, in the worker

    def configure(self) -> None:
        """Connect to the target, check it and send it controller, limits and references."""
        settings = self._settings
        guard = guard_of(settings, controller_of(settings))
        link = link_of(settings.link, self._enter_real_time)
        try:
            require_host_loop(settings, link)
            description = link.connect(self._watch)
            machine, wanted = description.machine, self._wanted(description)
            link.configure(wanted)
            protection = self._protection(description, wanted)
            levitated = _is_up(link.status())
            runs = self._watch.begin(description, settings.telemetry_block, settings.signals_rate)
        except Exception:
            link.close()
            self._watch.end()
            raise
        self._link, self._unsent = link, ""
        self._state.publish_machine(machine)
        self._ready = Rig(link, machine, runs, protection, guard)
        self.get_logger().info(
            f"machine {machine.name!r}, axes {', '.join(machine.axis_names)}, {machine.sample_rate:g} Hz, firmware "
            f"{description.firmware}"
        )
        if levitated:
            self.get_logger().info("the rotor is levitated: the target keeps its settings until it has landed")
        self._note_state()

    def activate(self) -> None:
        """Levitate. A rotor that is levitated already, since an earlier bridge left it so, stays as it is."""
        link = self._connected()
        if self._open_sockets and self._settings.network == "refuse":
            raise TargetError(
                f"{self._reach()}; start it with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, or with network: allow in "
                "its parameter file"
            )
        status = link.status()
        self._require_same_machine()
        if self._watch.latched():
            raise TargetError("trips are latched; reset the faults first")
        if self._unsent:
            self._send(link)
        if status.state in (TargetState.OFF, TargetState.LANDING):
            self._waits.for_state((TargetState.OFF,), self._settings.landing_time, self._require_wanted)
            if link.settings_wait:
                self._send(link)
            self._rehearse()
            seconds = self._settings.levitation_time if self._host_loop is None else 0.0  # the reference is the host's
            with self._lifting:
                self._require_wanted()
                link.levitate(seconds)
            try:
                self._waits.for_state((TargetState.LEVITATED,), seconds, self._require_wanted)
                self._waits.for_run(self._require_wanted)
            except AmbError as problem:
                self._give_up(link, problem)
                raise
        self._waits.for_run(self._require_wanted)
        self._excitable = True
        self._note_state()

    def deactivate(self) -> None:
        """Stop the excitation and land; nothing to do if protection has switched off.

        Raises
        ------
        TargetError
            If the target cannot be reached, or does not land: the rotor may be up.
        """
        excitable, self._excitable = self._excitable, False
        if self._excitation is not None:
            self._excitation.call_off()
        link = self._connected()
        try:
            self._land(link)
            self._waits.for_state(OFF, self._settings.landing_time)
        except AmbError:
            self._excitable = excitable
            raise
        if link.settings_wait:
            self._send_settings()
        self._note_state()

    def holds_on(self) -> bool:
        """Whether the rotor is up, so that there is something to land although the node is not active."""
        status = self._watch.status
        return self._link is not None and status is not None and status.state not in OFF

    def _give_up(self, link: TargetLink, problem: AmbError) -> None:
        """Land a rotor whose levitation has failed: a node that is not active must not leave it up."""
        try:
            self._land(link)
        except TargetError as failure:
            raise TargetError(f"{one_line(problem)}; the rotor could not be landed: {one_line(failure)}") from problem

    def _land(self, link: TargetLink) -> None:
        with self._lifting:  # no slow landing follows one at once
            if _is_up(link.status()):
                link.land(self._settings.landing_time)

    def clean_up(self) -> None:
        """Leave the target as it is."""
        self._excitable = False
        link, self._link = self._link, None
        if link is not None:
            link.close()
        self._watch.end()
        self._unsent = ""
        self._note_state()

    def _enter_real_time(self) -> None:
        """In the thread of the link, when it starts."""
        if problem := enter_real_time(self._settings.real_time):
            self.get_logger().warning(problem)

    def _link_of_host_loop(self) -> HostLoopLink | None:
        return self._link if isinstance(self._link, HostLoopLink) else None

    def _rehearse(self) -> None:
        """Where a controller node closes the loop, see that it answers before there is a rotor to hold."""
        if self._host_loop is not None:
            position = self._watch.runs.position if self._watch.runs is not None else np.zeros(0)
            self._host_loop.rehearse(self._watch.new_run(), np.nan_to_num(position).tolist())

    def _reach(self) -> str:
        return f"other hosts of the network reach this node at {', '.join(self._open_sockets)}, and may command the rig"

    def _connected(self) -> TargetLink:
        if self._link is None:
            raise TargetError("the bridge is not configured")
        return self._link

    def _require_wanted(self) -> None:
        """Raise CalledOffError if a levitation is not wanted any more."""
        if self.called_off.is_set():
            raise CalledOffError("called off, by a request to land, to switch off or to end")

    def _require_same_machine(self) -> None:
        """Raise TargetError if the target is another machine since its reboot."""
        if self._watch.known is not None and self._watch.known.machine != self._watch.machine:
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
        without_host = settings.without_host if settings.mode == "host" else ""
        return TargetSettings(controller_of(settings), limits, settings.landing_reference, without_host)

    def _protection(self, description: TargetDescription, wanted: TargetSettings) -> ExcitationProtection:
        """What excitations of this target are checked against."""
        return ExcitationProtection(
            self._settings.protection, wanted.limits, description.machine, description.waveform_steps
        )

    # -- news of the rig, in the thread of the link

    def _on_stopped(self, step: int) -> None:
        if self._excitation is not None:
            self._excitation.end(step)

    def _on_switched_off(self) -> None:
        """By a trip, by its own landing or by somebody beside it; also at the end of every landing of ours."""
        self.worker.submit(self._leave_active)

    def _leave_active(self) -> None:
        """In the worker: a later levitation may have begun meanwhile."""
        status = self._watch.status
        if status is not None and status.state in OFF and self.state_label == "active":
            self.get_logger().warning("the target has switched off")
            self._fall_back()

    def _on_rebooted(self) -> None:
        self._unsent = "the target has not got its settings since its reboot"
        self._excitable = False
        self._note_state()
        self.fall_back()
        self.worker.submit(self._send_settings)

    # -- settings

    def _send_settings(self) -> None:
        """Send controller, limits and references again; a refusal is part of the state until they are taken."""
        if self._link is None:
            return
        try:
            self._send(self._link)
        except AmbError as problem:
            self._unsent = one_line(problem)
            self.get_logger().error(f"the target has not taken the settings: {self._unsent}")
        self._note_state()

    def _send(self, link: TargetLink) -> None:
        self._require_same_machine()
        assert self._watch.known is not None and self._ready is not None  # since it is configured
        wanted = self._wanted(self._watch.known)
        link.configure(wanted)
        self._ready = replace(self._ready, protection=self._protection(self._watch.known, wanted))
        self._unsent = ""

    # -- services, parameters and health

    def _on_reset_faults(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        link = self._connected()
        self.get_logger().info("reset_faults: asked for")
        self._watch.report_trips()
        link.reset_faults()
        self._watch.forget_own_trips()
        self.problem = self.refusal = ""
        self._watch.on_status(link.status())
        response.success = True
        self._note_state()
        return response

    def _on_off(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Currents off, in whatever state target and node are; the rotor falls onto its backup bearings."""
        self.called_off.set()
        self.get_logger().warning("off: asked for")
        self._excitable = False
        link = self._link
        if link is None:  # as after a killed bridge, which has left the rotor levitated
            switch_off(self._settings.link)
        else:
            with self._lifting:
                link.land(0.0)
            self.fall_back()
        response.success = True
        return response

    def _on_timer(self) -> None:
        self._watch.flush()
        self._note_state()

    def _note_state(self) -> None:
        self._state.publish(self._link, *self._problems(), self.problem, self.refusal)

    def report_transition(self) -> None:
        """Publish the state: its `problem` is why a transition failed or was refused."""
        self._note_state()

    def _check_parameters(self, parameters: BridgeParameters) -> None:
        """Refuse what the operator has not allowed, and less protection than now while the rotor is not off."""
        if self._start is None:
            return
        self._start.allowed.require(parameters, self._start)
        parameters.protection.require_no_looser(self._start.protection, "at the start of this node")
        status = self._watch.status
        if status is not None and status.state is not TargetState.OFF:
            parameters.protection.require_no_looser(self._settings.protection, "now, while the rig is on")

    def _on_parameters(self, parameters: BridgeParameters) -> None:
        before, after = flatten(self._settings.model_dump()), flatten(parameters.model_dump())
        changed = ", ".join(f"{name} = {value}" for name, value in after.items() if value != before[name])
        self.get_logger().info(f"parameters set: {changed or 'as before'}")
        self._settings = parameters
        self.worker.submit(self._send_settings)

    def _report(self) -> diagnostics.Report:
        known, settings = self._watch.known, self._settings
        waits = self._link is not None and self._link.settings_wait
        limits = None
        if known is not None and not waits:
            limits = settings.protection.lowered(known.limits, settings.current_limit)
        problem = "; ".join(filter(None, self._problems())) or self._failure()
        refused = "" if self._host_loop is None else self._host_loop.problem
        warning = "; ".join(filter(None, (self._losses.text(self._link), refused, SETTINGS_WAIT * waits)))
        return report(self.state_label, self._watch, self._link, limits, problem, warning)

    def _problems(self) -> tuple[str, ...]:
        """What is wrong now, as far as it is not a transition."""
        error = self._link.error if self._link is not None else ""
        return self._watch.latched(), STANDS_STILL * self._watch.standing, self._unsent, error

    def _failure(self) -> str:
        """Why the last transition failed: shown as an event, but as long as the rotor is up nevertheless."""
        if self.problem != self.failure.last:  # another one has been done since, or the faults are reset
            return ""
        status = self._watch.status
        up = status is not None and status.state not in OFF
        return self.problem if up else self.failure.text


def _is_up(status: TargetStatus) -> bool:
    """Whether the rotor is levitated and not about to land."""
    return status.state in (TargetState.LEVITATING, TargetState.LEVITATED)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(partial(HardwareBridgeNode, args or sys.argv), args)


if __name__ == "__main__":
    raise SystemExit(main())
