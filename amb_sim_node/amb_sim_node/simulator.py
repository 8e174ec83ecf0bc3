"""Node `simulator`: the plant of amb_core behind topics, in lock-step with the controller.

It publishes the position of step k, waits for the current reference of step k, advances the plant by one controller
sample and publishes the position of step k + 1. Nothing depends on timing: the node waits for a late answer, and
publishes an unanswered position again once a controller listens. With a real-time factor a position is held back until
it is due; one that is late is counted, and no sample changes.
"""

from __future__ import annotations

import time

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from amb_core.ground.errors import AmbError, MessageError, ParameterError, PlantError
from amb_core.ground.parameters import load_parameters
from amb_core.loop.machine import Machine as MachineDescription
from amb_core.loop.pace import Pace, pace_values
from amb_core.loop.real_time import enter_real_time
from amb_core.plant import Plant
from amb_core.recording.messages.machine import fill_machine
from amb_core.recording.messages.plant_state import fill_plant_state
from amb_core.recording.messages.time_stamp import last_stamped_step, set_step_time
from amb_msgs.msg import (
    CurrentReference,
    Machine,
    MachineAxis,
    MachineBearing,
    PlantState,
    RotorPosition,
    SimulatorState,
)
from amb_msgs.srv import GetState, Pause, Reset, RunSteps
from amb_ros import diagnostics, topics
from amb_ros.alarms import RecentProblem
from amb_ros.parameters import declare, replace
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED, STREAM
from amb_ros.sample_messages import pack_position, unpack_current
from amb_ros.services import create_service
from amb_ros.simulator_modes import MODE_NAMES
from amb_sim_node.parameters import SimulatorParameters, pace_refusal


class SimulatorNode(Node):
    """The simulator. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("simulator", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        settings = declare(self, SimulatorParameters)
        self._pace: Pace | None = None
        self._use(settings, _compiled_plant(settings))
        self._sample_rate = settings.integration.sample_rate  # fixed: a reset to another one is refused

        self._clock_message = ClockMessage()
        self._state = SimulatorState(
            mode=SimulatorState.PAUSED,
            sample_time=self._plant.sample_time,
        )
        self._fault = ""
        self._in_contact = False  # at the present step
        self._contact_steps = 0  # of this run
        self._reported_contact_steps = 0  # at the last report
        self._answered = True  # False between the publication of a step and its answer
        self._seen_step = -1  # step at the last call of the watch
        self._refused_currents = 0
        self._current_problem = RecentProblem()

        self._position_publisher = self.create_publisher(RotorPosition, topics.POSITION, STREAM)
        self._clock_publisher = self.create_publisher(ClockMessage, topics.clock(self.get_namespace()), STREAM)
        self._plant_state_publisher = self.create_publisher(PlantState, topics.PLANT_STATE, HISTORY)
        self._machine_publisher = self.create_publisher(Machine, topics.MACHINE, LATCHED)
        self._state_publisher = self.create_publisher(SimulatorState, topics.SIMULATOR_STATE, EVERY_STATE)
        self._current_subscription = self.create_subscription(
            CurrentReference, topics.CURRENT_REFERENCE, self._on_current_reference, STREAM, raw=True
        )
        create_service(self, Reset, "~/reset", self._on_reset)
        create_service(self, Pause, "~/pause", self._on_pause)
        create_service(self, RunSteps, "~/run", self._on_run)
        create_service(self, GetState, "~/get_state", self._on_get_state)
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.POSITION, topics.SIMULATOR_STATE, topics.CURRENT_REFERENCE)
        )
        self._watch = self._create_watch()
        self._machine: MachineDescription | None = None  # as last published
        if problem := enter_real_time(settings.real_time):
            self.get_logger().warning(problem)
        self._reset()
        if self._settings.autostart:
            self._start(0)

    # -- the loop

    def _on_current_reference(self, data: bytes) -> None:
        try:
            run, step, current = unpack_current(data)
        except MessageError as problem:
            self._refuse_current(f"a current_reference is ignored: {problem}")
            return
        state = self._state
        if self._answered or step != state.step or run != state.run:
            return  # answer to a past step: published twice, or before a reset
        if state.mode not in (SimulatorState.RUNNING, SimulatorState.WAITING):
            return  # paused meanwhile; the step is published again when the run continues
        if len(current) != len(self._plant.machine.axes):
            names = self._plant.machine.axis_names
            self._refuse_current(
                f"current_reference of step {step} has {len(current)} values and is ignored; allowed: {len(names)}, "
                f"{', '.join(names)}"
            )
            return
        self._answered = True
        try:
            self._plant.advance(current)
        except PlantError as problem:
            self._fault = str(problem)
            self.get_logger().error(self._fault)
            self._set_mode(SimulatorState.FAULT)
            return
        state.step += 1
        self._look_inside()
        if self._plant.delevitated:
            self.get_logger().warning(f"delevitated before step {state.step} of run {state.run}")
            self._set_mode(SimulatorState.DELEVITATED)
        elif state.step == state.last_step:
            self._set_mode(SimulatorState.PAUSED)
        else:
            if state.mode == SimulatorState.WAITING:
                self._set_mode(SimulatorState.RUNNING)
            if self._pace is not None:
                self._hold_back(self._pace)
            self._publish_position()

    def _hold_back(self, pace: Pace) -> None:
        """Wait until the step is due. Periods are short, so that services may wait for it."""
        wait = pace.wait(time.monotonic())
        if wait > 0.0:
            time.sleep(wait)
            pace.published(time.monotonic())

    def _refuse_current(self, problem: str) -> None:
        self._refused_currents += 1
        self.get_logger().error(problem, throttle_duration_sec=5.0)
        if self._current_problem.note(problem):
            self._diagnostics.publish()

    def _publish_position(self) -> None:
        step = self._state.step
        self._answered = False
        self._position_publisher.publish(
            pack_position(self._state.run, step, step / self._sample_rate, self._plant.position)
        )
        if step % self._clock_steps == 0:
            self._publish_clock()

    def _publish_machine(self) -> None:
        """Publish what the plant is, if it has changed."""
        if self._machine != self._plant.machine:
            self._machine = self._plant.machine
            message = fill_machine(Machine(), MachineAxis, MachineBearing, self._machine)
            message.header.stamp = Clock(clock_type=ClockType.SYSTEM_TIME).now().to_msg()
            self._machine_publisher.publish(message)

    def _publish_clock(self) -> None:
        set_step_time(self._clock_message.clock, self._state.step, self._sample_rate)
        self._clock_publisher.publish(self._clock_message)

    def _look_inside(self) -> None:
        """Publish the state of the plant at every step at which it is due, and detect contact where it is possible."""
        run, step, every = self._state.run, self._state.step, self._settings.plant_state_steps
        if every > 0 and step % every == 0:
            snapshot = self._plant.snapshot()
            self._plant_state_publisher.publish(fill_plant_state(PlantState(), snapshot, run, step, self._sample_rate))
        if self._settings.backup_bearing.contact:
            self._note_contact(self._plant.contact)

    def _note_contact(self, in_contact: bool) -> None:
        """Count the steps in contact. The first of a run is reported at once, those of a bouncing rotor later."""
        self._in_contact = in_contact
        self._contact_steps += in_contact
        if in_contact and self._contact_steps == 1:
            state = self._state
            self.get_logger().warning(f"the rotor touches the backup bearing at step {state.step} of run {state.run}")
            self._diagnostics.publish()

    def _create_watch(self) -> Timer:
        return self.create_timer(
            self._settings.answer_timeout, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _on_watch(self) -> None:
        """Check whether the controller still answers, and publish an unanswered step again once a node listens."""
        state = self._state
        if state.mode == SimulatorState.RUNNING:
            if state.step == self._seen_step:
                self._set_mode(SimulatorState.WAITING)
            else:
                self._publish_state()
        if state.mode == SimulatorState.WAITING and self._position_publisher.get_subscription_count() > 0:
            self._start_pace()
            self._publish_position()
        self._seen_step = state.step

    # -- scenario control

    def _on_reset(self, request: Reset.Request, response: Reset.Response) -> Reset.Response:
        response.run = self._state.run
        if request.parameter_file:
            self._take_parameters(request.parameter_file)
        self._reset()
        response.success = True
        response.run = self._state.run
        return response

    def _on_pause(self, _request: Pause.Request, response: Pause.Response) -> Pause.Response:
        if self._state.mode in (SimulatorState.RUNNING, SimulatorState.WAITING):
            self._set_mode(SimulatorState.PAUSED)
        response.success = True
        response.run = self._state.run
        response.step = self._state.step
        return response

    def _on_run(self, request: RunSteps.Request, response: RunSteps.Response) -> RunSteps.Response:
        state = self._state
        most = last_stamped_step(self._sample_rate) - state.step
        if request.steps > most:
            response.message = (
                f"steps = {request.steps} is not allowed; allowed: 0 (until paused) to {most}, the largest number for "
                "which a ROS time stamp can represent the simulation time"
            )
        elif refusal := pace_refusal(request.real_time_factor, self._sample_rate):
            response.message = refusal
        elif state.mode == SimulatorState.PAUSED:
            self._use_pace(request.real_time_factor or self._settings.real_time_factor)
            self._start(request.steps)
            response.success = True
        else:
            over = state.mode in (SimulatorState.DELEVITATED, SimulatorState.FAULT)
            remedy = "reset it first" if over else "pause it first"
            response.message = f"the simulator is {MODE_NAMES[state.mode]} at step {state.step}; {remedy}"
        response.run = state.run
        response.first_step = state.step
        response.last_step = state.last_step
        return response

    def _on_get_state(self, _request: GetState.Request, response: GetState.Response) -> GetState.Response:
        self._stamp_state()
        response.success = True
        response.state = self._state
        return response

    def _take_parameters(self, path: str) -> None:
        """Load all parameters and a new plant from a file; on an error nothing changes.

        Raises
        ------
        AmbError
            If the file, a parameter or the plant is wrong; the message names the file.
        """
        settings = load_parameters(SimulatorParameters, path, self.get_fully_qualified_name())
        rate = settings.integration.sample_rate
        where = f"parameter file {path}, node {self.get_name()}"
        if rate != self._sample_rate:
            raise ParameterError(
                f"{where}: parameter 'integration.sample_rate' = {rate:g} Hz is not allowed; allowed: "
                f"{self._sample_rate:g} Hz, at which the simulator was started"
            )
        try:
            plant = _compiled_plant(settings)
        except AmbError as problem:
            raise PlantError(f"{where}: {problem}") from None
        replace(self, settings)
        self._use(settings, plant)
        self.destroy_timer(self._watch)
        self._watch = self._create_watch()

    def _use(self, settings: SimulatorParameters, plant: Plant) -> None:
        self._settings, self._plant = settings, plant
        self._clock_steps = max(round(settings.clock_period * settings.integration.sample_rate), 1)
        self._use_pace(settings.real_time_factor)

    def _use_pace(self, factor: float) -> None:
        if factor == 0.0:
            self._pace = None
            return
        period = self._plant.sample_time / factor
        if self._pace is None or self._pace.period != period:  # its counts go on where it stays
            self._pace = Pace(period)

    def _reset(self) -> None:
        self._plant.reset()
        self._publish_machine()
        self._fault = ""
        self._in_contact, self._contact_steps, self._reported_contact_steps = False, 0, 0
        self._answered = True
        self._state.run = _next_run(self._state.run)
        self._state.step = 0
        self._state.last_step = 0
        self._set_mode(SimulatorState.PAUSED)
        self._publish_clock()
        self._look_inside()

    def _start(self, steps: int) -> None:
        self._state.last_step = self._state.step + steps if steps else 0
        self._seen_step = -1
        self._set_mode(SimulatorState.RUNNING)
        self._start_pace()
        self._publish_position()

    def _start_pace(self) -> None:
        if self._pace is not None:
            self._pace.start(time.monotonic())

    # -- state and health

    def _set_mode(self, mode: int) -> None:
        self._state.mode = mode
        self._publish_state()
        self._diagnostics.publish()

    def _stamp_state(self) -> None:
        self._state.plant_state_steps, self._state.clock_steps = self._settings.plant_state_steps, self._clock_steps
        set_step_time(self._state.header.stamp, self._state.step, self._sample_rate)

    def _publish_state(self) -> None:
        self._state.sequence += 1
        self._stamp_state()
        self._state_publisher.publish(self._state)

    def _report(self) -> diagnostics.Report:
        state = self._state
        # A contact may end within milliseconds: those since the last report count too.
        touched = self._in_contact or self._contact_steps > self._reported_contact_steps
        self._reported_contact_steps = self._contact_steps
        listeners = self._position_publisher.get_subscription_count()
        if state.mode == SimulatorState.WAITING:
            level = diagnostics.ERROR
            summary = f"no answer from the controller to step {state.step}; {listeners} listening on position"
        elif state.mode == SimulatorState.FAULT:
            level, summary = diagnostics.ERROR, self._fault
        elif state.mode == SimulatorState.DELEVITATED:
            level, summary = diagnostics.ERROR, f"delevitated before step {state.step}"
        elif touched:
            level, summary = diagnostics.WARN, "the rotor touches the backup bearing"
        elif refused := self._current_problem.text:
            level, summary = diagnostics.WARN, refused
        else:
            level, summary = diagnostics.OK, MODE_NAMES[state.mode]
        mode = MODE_NAMES[state.mode]
        values = {
            "run": state.run,
            "step": state.step,
            "mode": mode,
            "steps in contact": self._contact_steps,
            "current references refused": self._refused_currents,
        }
        return level, summary, values if self._pace is None else values | pace_values(self._pace)


def _next_run(last: int) -> int:
    """Number of a new run: the wall clock in microseconds, since no reset follows another within a microsecond.

    So no number is used again after a restart of the simulator, however many resets there were before.
    """
    return max(last + 1, time.time_ns() // 1000)


def _compiled_plant(parameters: SimulatorParameters) -> Plant:
    """A plant after its reset, with compiled code: the first sample need not wait for the compiler.

    Raises
    ------
    AmbError
        If the parameters make no valid plant.
    """
    plant = Plant(parameters)
    plant.advance([0.0] * len(plant.machine.axes))
    plant.reset()
    return plant


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(SimulatorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
