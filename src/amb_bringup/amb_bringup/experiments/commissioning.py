"""Commissions a rig step by step through the nodes of its graph; `amb_core.rig.commissioning` decides what passes.

Each step returns its checks. After one that fails no further step moves the rotor: the rotor is landed, and what was
measured so far is written. So is it after an error and after Ctrl-C.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray

from amb_bringup.client import AmbClient
from amb_bringup.client.errors import ClientError
from amb_bringup.client.rig import MODES
from amb_bringup.experiments.measurements import SETTLING, Measurements, whole
from amb_bringup.experiments.wiring import Wiring, require_rest
from amb_core.designs.excitation.beyond_a import highest_load
from amb_core.excitation import generate
from amb_core.ground.errors import AmbError, one_line
from amb_core.ground.files.parameter_files import BRIDGE_NODE
from amb_core.ground.units import UM
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.machine import Machine, radial_bearings
from amb_core.loop.telemetry import merge_blocks
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.machine import machine_from_message
from amb_core.regions.region_map import RegionMap
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.closed_loop import closed_loop_chart
from amb_core.report.figures.loop import orbit_chart, response_chart
from amb_core.rig import commissioning as core
from amb_core.rig.commissioning import Check, CommissioningSettings, Expected, Protocol, Step, at_most, measured
from amb_core.rig.link.link import LevitatedError
from amb_msgs.msg import BridgeState
from amb_msgs.msg import Machine as MachineMessage
from amb_ros import interruptions, topics
from amb_ros.qos import HISTORY, LATCHED
from amb_ros.subscriptions import create_subscription
from amb_sim_node.bridge_parameters import BridgeParameters

START = 1.0  # s after the connection: the first telemetry comes in a burst
REST = 1.0  # s of rest after a levitation; half of it is evaluated
BEFORE_STOP = 0.5  # s for which the tone plays that is stopped
FADING = 30.0  # s of wall-clock time for a fade
TRIP_TIMEOUT = 5.0  # s until the trip after a failed levitation has arrived
ROUND_TRIP, CLOCK_DRIFT = "round trip (ms)", "clock of the target (ppm)"  # keys of the bridge's diagnostics


@dataclass
class Session:
    """A commissioning in progress.

    Attributes
    ----------
    amb : AmbClient
        In the graph of the rig.
    settings : CommissioningSettings
        Excitations and limits.
    bridge : BridgeParameters
        Of the bridge in that graph.
    expected : Expected or None
        Of the model of the machine.
    region_map : RegionMap or None
        That excitations are checked against.
    confirm : callable
        Asks whether something may be done, or was seen; True if so. None: nobody is asked and nothing is seen.
    check : callable
        Raises AmbError if a node of the graph has ended.
    show : callable
        Called with each step when it begins, and when it has ended.
    wiring : bool
        Whether sensors and coils are checked before the bridge is connected.
    protocol, figures, model
        What was done, what it looks like, and the identified model if there is one.
    """

    amb: AmbClient
    settings: CommissioningSettings
    bridge: BridgeParameters
    expected: Expected | None
    region_map: RegionMap | None
    confirm: Callable[[str], bool] | None
    check: Callable[[], None]
    show: Callable[[Step], None]
    wiring: bool = True
    protocol: Protocol = field(default_factory=Protocol)
    figures: dict[str, Chart] = field(default_factory=dict)
    model: StateSpaceModel | None = None

    def __post_init__(self) -> None:
        node = self.amb.node
        self._measured = Measurements(self.amb, lambda: self.machine)
        self._machine: Machine | None = None
        self._link: dict[str, str] = {}
        self._of_another = False  # whether another host levitates the rotor
        self._bridged = False  # whether the bridge was asked to connect
        self._currents = "no answer of the target so far"  # why they may flow while it is not; empty: they are off
        self._bridge_name = f"{node.get_namespace().rstrip('/')}/{BRIDGE_NODE}"
        create_subscription(node, MachineMessage, topics.MACHINE, self._on_machine, LATCHED)
        create_subscription(node, DiagnosticArray, "/diagnostics", self._on_diagnostics, HISTORY)

    @property
    def machine(self) -> Machine:
        """The machine of the target; known once the bridge is connected."""
        self.amb.wait_until(lambda: self._machine is not None, complaint="no machine of hardware_bridge")
        assert self._machine is not None
        return self._machine

    @property
    def order(self) -> int | Literal["auto"]:
        """Order of the model that is identified, and of the one in a report on the recording."""
        return core.order_of_rig(len(self.machine.axes))

    def carry_out(self, bag: Path) -> Protocol:
        """All steps; the rotor is landed at the end in every case, unless another host levitates it.

        Parameters
        ----------
        bag : Path
            Folder of the bag that is made once the target is connected.
        """
        try:
            if self.wiring:
                self._wire()
            self._step("connection", "Connect to the target and observe the link", lambda: self._begin(bag))
            self._step("sensors", "Sensors while the rotor rests, currents off", self._sensors)
            self._step("emergency stop", "Emergency stop, by hand, currents off", self._emergency_stop)
            self._step("levitation", "Levitate, land, and levitate again", self._levitate, "levitate the rotor")
            self._step("polarity", "Polarity and calibration: small steps of each reference", self._polarity, "excite")
            self._step("protection", "Stop an excitation while it plays", self._protection, "excite and stop")
            self._step("map", "Excitations on the region map", self._map)
            self._step("sweep", "Sweep of each axis in region A", self._sweep, "sweep each axis")
            self._step("identification", "Identify the plant", self._identify, "excite with a multisine")
        finally:
            with interruptions.held_back():  # a second Ctrl-C waits until the rotor has landed
                self._step("landing", "Land", self._land, always=True)
                if bag.exists():
                    state = self.amb.rig.wait_for_state()
                    self.amb.stop_recording(int(state.run), int(state.step))
        return self.protocol

    def _wire(self) -> None:
        """The steps over a link of its own, which is closed before the bridge connects."""
        opened: list[Wiring] = []

        def begin() -> list[Check]:
            opened.append(Wiring(self.bridge, self.settings, self.expected, self.confirm, self.check))
            return opened[0].before_lift()

        try:
            title = "Sensors and coils: small currents on the backup bearing"
            self._step("wiring", title, begin, "let small currents flow")
            title = "First lift-off: noise, gains, delays, angles"
            if opened:
                self._step("first lift", title, opened[0].lift, "levitate the rotor")
        finally:
            for one in opened:
                self._currents = one.close()

    def _step(
        self, name: str, title: str, action: Callable[[], list[Check]], moves: str = "", always: bool = False
    ) -> None:
        """Carry out a step, unless one before it has failed or the user refuses it."""
        step = Step(name, title)
        self.protocol.steps.append(step)
        try:
            self.show(step)
            step.skipped = "" if always else self._obstacle(name, title, moves)
            if not step.skipped:
                self._carry_out(step, action)
        except BaseException as problem:  # the protocol is written all the same: the step has not passed
            step.problem = _why_it_ended(problem)
            raise
        self.show(step)

    def _obstacle(self, name: str, title: str, moves: str) -> str:
        """Why a step is not carried out; empty if it is."""
        if failed := self.protocol.failed:
            return f"{failed[0].name} has failed"
        if moves and name not in ("wiring", "first lift", "levitation") and not self._measured.run:
            return "the rotor is not levitated"
        if moves and self.confirm is not None and not self.confirm(f"{title}: {moves} now?"):
            return "not confirmed"
        return ""

    def _carry_out(self, step: Step, action: Callable[[], list[Check]]) -> None:
        began = time.monotonic()
        step.began = datetime.now(UTC).astimezone().isoformat(timespec="seconds")
        try:
            step.checks = action()
        except _NotDoneError as reason:
            step.skipped = str(reason)
        except AmbError as problem:
            self._of_another = self._of_another or isinstance(problem, LevitatedError)
            step.problem = self._why(problem)
        finally:
            step.seconds = round(time.monotonic() - began, 3)

    def _why(self, problem: AmbError) -> str:
        """A problem, or the node that has ended and thereby caused it."""
        try:
            self.check()
        except AmbError as ended:
            return str(ended)
        return str(problem)

    # -- steps

    def _begin(self, bag: Path) -> list[Check]:
        checks = self._connect()
        if all(check.passed is not False for check in checks):
            self.amb.start_recording(bag)
        return checks

    def _connect(self) -> list[Check]:
        settings, rig = self.settings, self.amb.rig
        if not self.wiring:  # otherwise the steps before have seen it
            require_rest(self.bridge, self.check)
        self._bridged = True
        rig.connect()
        self._spend(START)
        machine, before = self.machine, rig.wait_for_state()
        self._spend(settings.observation)
        self.amb.wait_until(
            lambda: all(self._link.get(key, "-") != "-" for key in (ROUND_TRIP, CLOCK_DRIFT)),
            complaint="round trip and clock drift are not known: no /diagnostics of hardware_bridge",
        )
        after = rig.wait_for_state()
        for key in ("firmware", "limits in force"):
            self.protocol.about[key] = self._link.get(key, "-")
        self.protocol.about["machine"] = (
            f"{machine.name}, axes {', '.join(machine.axis_names)}, {machine.sample_rate:g} Hz"
        )
        lost = (after.lost - before.lost) / max(after.target_step - before.target_step, 1)
        advice = "another switch, cable or network card; nothing else on the network of the rig"
        return [
            measured("machine", self.protocol.about["machine"]),
            measured("firmware", self.protocol.about["firmware"]),
            at_most("share of telemetry lost", lost, settings.lost_share, "-", advice),
            at_most("control steps missed", float(after.missed - before.missed), settings.most_missed, "-",
                    "the control step takes too long, or something interrupts it: see target/PORTING.md"),
            at_most("round trip of a command", float(self._link[ROUND_TRIP]), 1e3 * settings.round_trip, "ms", advice),
            at_most("drift of the target's clock", abs(float(self._link[CLOCK_DRIFT])), settings.clock_drift, "ppm",
                    "the sample rate of the target is not what its configuration says"),
        ]  # fmt: skip

    def _sensors(self) -> list[Check]:
        state = self.amb.rig.wait_for_state()
        if state.mode not in (BridgeState.OFF, BridgeState.TRIPPED):
            if state.mode == BridgeState.UNREACHABLE:
                raise AmbError("the target does not answer any more")
            raise LevitatedError
        positions: list[NDArray[np.float64]] = []
        until, seen = time.monotonic() + self.settings.observation, state.sequence
        while time.monotonic() < until or len(positions) < 2:
            state = self.amb.rig.wait_for_state()
            if state.sequence != seen:
                seen = state.sequence
                positions.append(np.array(state.position))
            self.amb.spin_once()
        return core.rest_checks(np.array(positions), self.machine, self.settings)

    def _emergency_stop(self) -> list[Check]:
        if self.confirm is None:
            raise _NotDoneError(
                "nobody was asked; press it with the rotor at rest: the amplifiers must lose their supply"
            )
        seen = self.confirm("Press the emergency stop. Did the amplifiers lose their supply?")
        if seen and not self.confirm("Release it and switch the amplifiers on. Are they ready?"):
            raise AmbError("the amplifiers are not ready")
        self.amb.rig.reset_faults()
        return [Check("emergency stop", "works" if seen else "not seen to work", limit="works", passed=seen,
                      advice="do not levitate before it works; software protects no people")]  # fmt: skip

    def _levitate(self) -> list[Check]:
        first, _ = whole(self._one_levitation)
        second, checks = whole(self._one_levitation)
        change = UM * float(np.abs(second - first).max())
        limit = UM * self.settings.repeatability
        return [*checks, at_most("change of the position from the first to the second", change, limit, "um",
                                 "hysteresis, a sensor or a support that is loose")]  # fmt: skip

    def _one_levitation(self) -> tuple[NDArray[np.float64], list[Check]]:
        """Levitate, and look at the rotor once it rests. Returns its position (m), and the checks."""
        machine, rig = self.machine, self.amb.rig
        if rig.is_up():
            rig.land()
        try:
            self._measured.run = rig.levitate()
            stop = int(rig.wait_for_state().step) + self._measured.steps(REST)
            rig.wait_for_step(stop)
        except ClientError as problem:
            self._measured.run = 0
            raise AmbError(f"{problem}{self._how_it_failed()}") from None
        record = self._measured.samples(0, stop)
        limits = np.minimum([axis.current_limit for axis in machine.axes], self.bridge.current_limit)
        checks = core.levitation_checks(record, machine, limits, self.settings)
        alarm = bool(rig.wait_for_state().alarm)
        checks.append(Check("alarm", "on" if alarm else "off", limit="off", passed=not alarm))
        rest = record.window(stop - self._measured.steps(0.5 * REST), self._measured.steps(0.5 * REST))
        if radial_bearings(rest):
            self.figures["orbit"] = orbit_chart(rest, title="Orbit of the levitated rotor at rest")
        return rest.position.mean(axis=0), checks

    def _how_it_failed(self) -> str:
        """What the telemetry before the last trip shows, as a clause; empty without."""
        trips = self.amb.rig.trips
        try:
            self.amb.wait_until(lambda: bool(trips), TRIP_TIMEOUT)
        except ClientError:
            return ""
        blocks = [block_from_message(block) for block in trips[-1].before]
        if not blocks:
            return ""
        record = merge_blocks(blocks)
        self.figures["before_trip"] = response_chart(record, title="The rotor before the trip")
        return f"; {core.runaway(record, self.machine)}"

    def _polarity(self) -> list[Check]:
        machine = self.machine
        excitation = core.small_steps(self.settings, len(machine.axes))
        started = self._measured.excite(excitation)
        self.figures["small_steps"] = response_chart(
            self._measured.record(started), title="Small steps of each reference"
        )
        response = core.static_response(self._measured.of_each_axis(excitation, started, before=1, after=1))
        rest = self._measured.rest_before(started)
        return core.calibration_checks(response, rest.current.mean(axis=0), machine, self.settings, self.expected)

    def _map(self) -> list[Check]:
        if self.region_map is None:
            raise _NotDoneError("no --map was given")
        checks = []
        for excitation in (core.sweep(self.settings), core.multisine(self.settings)):
            signal = generate(excitation, self.machine.sample_rate, self.machine)
            highest = highest_load(signal, self.region_map, self.bridge)
            advice = "lower its amplitude, or its highest frequency"
            what = f"load of the {excitation.kind} on {highest.axis}, 1: end of region A"
            checks.append(at_most(what, highest.load, 1.0, "-", advice))
        return checks

    def _sweep(self) -> list[Check]:
        excitation = core.sweep(self.settings)
        started = self._measured.excite(excitation)
        records = self._measured.of_each_axis(excitation, started, after=self._measured.steps(SETTLING))
        band = excitation.frequency_start, excitation.frequency_end
        loops = [core.closed_loop(record, axis, band) for axis, record in enumerate(records)]
        models = None
        if (expected := self.expected) is not None:
            models = [expected.response(loop.frequency, axis) for axis, loop in enumerate(loops)]
        self.figures["closed_loop"] = closed_loop_chart(loops, models)
        return [self._measured.region(started), *core.resonance_checks(loops, self.settings, self.expected)]

    def _identify(self) -> list[Check]:
        started = self._measured.excite(core.multisine(self.settings))
        self.model = self.amb.identify(order=self.order, focus="simulation")
        rest = self._measured.rest_before(started)
        verdicts = core.model_checks(self.model, self._measured.record(started), rest, self.settings, self.expected)
        return [self._measured.region(started), *verdicts]

    def _protection(self) -> list[Check]:
        rig = self.amb.rig
        started = self.amb.start_excitation(
            "tones", **core.tone(self.settings, self.machine.axis_names[0]).model_dump()
        )
        rig.wait_for_step(started.first_step + self._measured.steps(BEFORE_STOP))
        asked = int(rig.wait_for_state().step)
        self.amb.stop_excitation()
        self.amb.wait_until(
            lambda: rig.wait_for_state().excitation == BridgeState.NONE, FADING, "the excitation goes on"
        )
        stop = int(rig.wait_for_state().step) + self._measured.steps(SETTLING)
        rig.wait_for_step(stop)
        record = self._measured.samples(started.first_step, stop)
        checks = core.fade_checks(record.reference, asked - started.first_step, record.sample_time, self.settings)
        return [*checks, Check("trips", "; ".join(trip.text for trip in rig.trips) or "none", limit="none",
                               passed=not rig.trips)]  # fmt: skip

    def _land(self) -> list[Check]:
        rig = self.amb.rig
        if self._of_another:
            raise _NotDoneError("another host levitates the rotor; it is left as it is")
        if not self._bridged or rig.life_cycle() == "unconfigured":
            if not self._currents:
                raise _NotDoneError("the bridge is not connected; the currents were off after the step before")
            raise AmbError(
                f"the bridge is not connected, and whether currents flow is not known: {self._currents}; look at the "
                "rig; then land with amb rig up, amb rig connect and amb rig land, or use the emergency stop"
            )
        rig.bring_down()
        self._measured.run = 0
        state = rig.wait_for_state()
        mode = MODES[state.mode]
        off = state.mode in (BridgeState.OFF, BridgeState.TRIPPED)
        place = ", ".join(f"{axis} {UM * value:.1f}" for axis, value in zip(state.axes, state.position, strict=False))
        return [
            Check("target", mode, limit="off or tripped", passed=off, advice="use the emergency stop"),
            measured("position", f"{place} um"),
        ]

    def _spend(self, seconds: float) -> None:
        """Listen for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.amb.spin_once()

    def _on_machine(self, message: MachineMessage) -> None:
        self._machine = machine_from_message(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if f"/{status.name}" == self._bridge_name:
                self._link = {item.key: item.value for item in status.values}


def _why_it_ended(problem: BaseException) -> str:
    """What ended a step that did not come to its end, in one line."""
    if isinstance(problem, KeyboardInterrupt):
        return "interrupted"
    return one_line(problem if isinstance(problem, AmbError) else f"internal error: {problem!r}")


class _NotDoneError(Exception):
    """A step was not done; the text says why."""
