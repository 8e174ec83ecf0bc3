"""Node `region_monitor`: the region in which the machine runs, live, and region maps as an action.

The classifier processes telemetry in the node's own thread. A map is built in a worker while the classification
continues.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.ground.errors import BagError, RegionError, one_line
from amb_core.ground.parameters import load_parameters, part_of
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.region_map import fill_region_map, map_settings_from_message
from amb_core.recording.messages.region_state import fill_region_state
from amb_core.regions import Region, RegionParameters, RegionState
from amb_core.regions.rehearsal import rehearse
from amb_ident_node import region_report
from amb_ident_node.machine_wait import MachineWait, Telemetry
from amb_ident_node.monitoring import RegionWatch
from amb_ident_node.recorded_topics import REGION_MESSAGES
from amb_ident_node.region_monitor_parameters import RegionMonitorParameters
from amb_msgs.action import BuildMap
from amb_msgs.msg import AxisRegion, BearingRegion, BridgeState, LoopSamples, RegionMap, SimulatorState
from amb_msgs.msg import RegionState as RegionStateMessage
from amb_ros import diagnostics, topics
from amb_ros.actions import create_action
from amb_ros.alarms import RecentProblem
from amb_ros.machine import MachineInput
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.subscriptions import create_subscription

if TYPE_CHECKING:
    from amb_core.loop.machine import Machine
    from amb_core.regions.region_map import MapProgress
    from amb_core.regions.region_map import RegionMap as BuiltMap

WAIT_PERIOD = 0.1  # s of wall-clock time between looks at what waits for the machine


class RegionMonitorNode(Node):
    """The region monitor. Topics, actions and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__(
            "region_monitor", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        self._settings = declare(self, RegionMonitorParameters)
        self._regions = part_of(RegionParameters, self._settings.model_dump())
        if self._settings.scheduler:
            from amb_core.ground.tasks.cluster import check_address  # loads the library of the cluster

            check_address(self._settings.scheduler)
        rehearse()  # nothing is compiled once telemetry arrives
        self._watch = RegionWatch(self._regions, self._settings.publish_period)
        self._wait = MachineWait(self._settings.machine_timeout)
        self._malformed = 0
        self._left_out = RecentProblem()  # steps that are missing, and blocks that are not classified
        self._sequence = 0  # of the last message on region
        self._maps = 0  # published
        self._building = ""  # progress of the map in progress
        self._ending = threading.Event()
        self._remote_parameters = RemoteParameters(self)
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="region_monitor")
        self._region_publisher = self.create_publisher(RegionStateMessage, topics.REGION, HISTORY)
        self._map_publisher = self.create_publisher(RegionMap, topics.REGION_MAP, LATCHED)
        self._machine_input = MachineInput(self, self._on_machine)
        self._telemetry_subscription = create_subscription(
            self, LoopSamples, topics.TELEMETRY, self._on_telemetry, HISTORY
        )
        self._state_subscription = create_subscription(
            self, SimulatorState, topics.SIMULATOR_STATE, self._take, EVERY_STATE
        )
        self._bridge_subscription = create_subscription(
            self, BridgeState, topics.BRIDGE_STATE, self._on_bridge_state, EVERY_STATE
        )
        self._wait_timer = self.create_timer(
            WAIT_PERIOD, self._on_wait_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._build_map = create_action(
            self, BuildMap, "~/build_map", self._on_build_map, self._worker, self._check_goal
        )
        self._diagnostics = diagnostics.DiagnosticsReporter(
            self, self._report, exclusive=(topics.TELEMETRY, topics.SIMULATOR_STATE)
        )

    def finish(self) -> None:
        """Cancel the map in progress (its finished sweeps stay in the cache)."""
        self._ending.set()
        self._worker.shutdown(cancel_futures=True)
        self._build_map.destroy()

    # -- topics

    def _on_machine(self, machine: Machine) -> None:
        self._watch.use(machine)
        self._process(self._wait.use(machine, time.monotonic()))

    def _on_telemetry(self, message: LoopSamples) -> None:
        try:
            self._take(Telemetry(message.run, block_from_message(message)))
        except BagError as problem:
            self._malformed += 1
            self._note_left_out(one_line(problem))

    def _take(self, message: Telemetry | SimulatorState) -> None:
        self._process(self._wait.add(message, time.monotonic()))

    def _on_wait_timer(self) -> None:
        self._process(self._wait.expire(time.monotonic()))

    def _process(self, messages: list[Telemetry | SimulatorState]) -> None:
        for message in messages:
            if isinstance(message, Telemetry):
                self._classify(message)
            else:
                self._on_simulator_state(message)

    def _classify(self, telemetry: Telemetry) -> None:
        restarts = self._watch.restarts
        try:
            states = self._watch.add_block(telemetry.run, telemetry.block)
        except RegionError as problem:
            self._note_left_out(one_line(problem))
            return
        if self._watch.restarts > restarts:
            self._note_left_out(self._watch.problem)
        self._publish(states)

    def _note_left_out(self, problem: str) -> None:
        self.get_logger().warning(problem, throttle_duration_sec=5.0)
        if self._left_out.note(problem):
            self._diagnostics.publish()

    def _on_simulator_state(self, message: SimulatorState) -> None:
        self._watch.begin(message.run)
        if message.mode == SimulatorState.DELEVITATED:
            self._publish(self._watch.delevitate(message.run, message.step))
        elif message.mode in (SimulatorState.PAUSED, SimulatorState.FAULT):
            self._publish(self._watch.stand(message.run, message.step))

    def _on_bridge_state(self, message: BridgeState) -> None:
        self._watch.begin(message.run)
        if message.run and message.mode in (BridgeState.OFF, BridgeState.TRIPPED):
            self._publish(self._watch.stand(message.run, message.step))

    def _publish(self, states: list[RegionState]) -> None:
        run, sample_time = self._watch.run, self._watch.sample_time
        if run is None or not self.context.ok():  # asked to stop during a burst of telemetry
            return
        for state in states:
            message = fill_region_state(RegionStateMessage(), AxisRegion, BearingRegion, state, run, sample_time)
            self._sequence += 1
            message.sequence, message.next_step = self._sequence, self._watch.next_step
            self._region_publisher.publish(message)

    # -- the action

    def _check_goal(self, goal: BuildMap.Goal) -> None:
        """Refuse a goal with impossible settings or files before it is accepted."""
        map_settings_from_message(goal)
        _new_file(goal.path)
        machine = self._machine_input.machine
        if goal.parameter_file:
            self._loop_parameters(goal.parameter_file)
        elif machine is not None and machine.source == "bridge":
            raise RegionError(
                f"the running machine {machine.name!r} is a rig: nobody knows its plant to simulate sweeps of it; give "
                "parameter_file with a plant like it"
            )

    def _on_build_map(
        self, goal: BuildMap.Goal, feedback: Callable[[BuildMap.Feedback], None], cancelled: Callable[[], bool]
    ) -> BuildMap.Result:
        # In the worker. Loads the library of the cluster, which a monitor without a map does not need.
        from amb_core.regions.region_map import build_map

        settings = map_settings_from_message(goal)
        plant, controller = self._loop_parameters(goal.parameter_file)
        regions = self._regions.model_copy(update={"backup_bearing_radius": plant.rotor.backup_bearing_radius})
        path = _new_file(goal.path)

        def report(progress: MapProgress) -> None:
            message = BuildMap.Feedback(done=progress.done, total=progress.total, reused=progress.reused)
            if progress.map is not None:
                self._fill_map(message.map, progress.map)
            self._building = f"{progress.done} of {progress.total} sweeps"
            feedback(message)

        def ended() -> bool:
            return cancelled() or self._ending.is_set()

        try:
            region_map = build_map(
                settings,
                plant,
                controller,
                regions,
                scheduler=self._settings.scheduler or None,
                progress=report,
                cancelled=ended,
            )
        finally:
            self._building = ""
        result = BuildMap.Result()
        self._fill_map(result.map, region_map)
        sweeps = f"{len(region_map.sweeps)} sweeps"
        if ended():
            result.message = f"cancelled after {sweeps}, which stay in the cache"
            return result
        self._publish_map(result.map)
        result.path = "" if path is None else _saved(region_map, path)
        resolved = "resolved" if region_map.complete else f"not resolved, max_sweeps = {settings.max_sweeps} are done"
        result.success = True
        result.message = f"{sweeps}, boundaries {resolved}"
        self.get_logger().info(f"region map: {result.message}")
        return result

    def _publish_map(self, message: RegionMap) -> None:
        self._maps += 1
        message.sequence = self._maps
        self._map_publisher.publish(message)

    def _fill_map(self, message: RegionMap, region_map: BuiltMap) -> None:
        fill_region_map(message, region_map)
        message.header.stamp = self._wall_clock.now().to_msg()

    def _loop_parameters(self, path: str) -> tuple[PlantParameters, ControllerParameters]:
        """The loop of the requested map: of a parameter file, or the running one."""
        names = self._settings.simulator, self._settings.controller
        if path:
            namespace = self.get_namespace().rstrip("/")
            plant_node, controller_node = (name if name.startswith("/") else f"{namespace}/{name}" for name in names)
            plant = load_parameters(PlantParameters, path, plant_node, part=True)
            controller = load_parameters(ControllerParameters, path, controller_node, part=True)
        else:
            timeout = self._settings.parameter_timeout
            plant = self._remote_parameters.read_set(PlantParameters, names[0], timeout)
            controller = self._remote_parameters.read_set(ControllerParameters, names[1], timeout)
        return plant, controller.at_rate(plant.integration.sample_rate)

    # -- health

    def _report(self) -> diagnostics.Report:
        watch = self._watch
        begins = watch.awaited is not None  # a run, of which nothing is known yet
        values: dict[str, object] = {
            "run": watch.run,
            "next step": watch.next_step,
            REGION_MESSAGES: self._sequence,
            "restarts": watch.restarts,
            "refused blocks": watch.refused,
            "malformed blocks": self._malformed,
            "region map": self._building or "none in progress",
        }
        level, summary = diagnostics.OK, f"no region yet in run {watch.awaited}" if begins else "no region yet"
        if watch.state is not None and not begins:
            region = watch.state.region
            level = {Region.A: diagnostics.OK, Region.D: diagnostics.ERROR}.get(region, diagnostics.WARN)
            summary = region_report.summary(watch.state)
            values |= region_report.shown(watch.state)
            values["not judged"] = watch.not_judged or "nothing"
            frozen = [axis.name for axis in watch.state.axes if axis.frozen]
            if frozen:
                problem = f"position {' and '.join(frozen)} does not change while the reference moves: sensor frozen?"
                return diagnostics.ERROR, problem, values
        if watch.conflict:
            return diagnostics.ERROR, f"{summary}; {watch.conflict}", values
        problems = [problem for problem in (self._left_out.text, self._machine_problem()) if problem]
        if problems:
            return max(level, diagnostics.WARN), "; ".join([summary, *problems]), values
        return level, summary, values

    def _machine_problem(self) -> str:
        """What the monitor waits for, or how it goes on without it; empty with the machine of the present run."""
        machine = self._machine_input.machine
        if not self._wait.missing:
            return self._watch.machine_problem if self._watch.run is not None else self._machine_input.problem
        why = self._machine_input.problem if machine is None else f"the machine has {', '.join(machine.axis_names)}"
        waiting = f"{self._wait.steps} steps of telemetry of the axes {', '.join(self._wait.missing)}"
        return f"{waiting} wait for their machine; {why}"


def _new_file(path: str) -> Path | None:
    """The requested file as an absolute path; refused before the work if its folder does not exist."""
    if not path:
        return None
    try:
        file = Path(path).expanduser().absolute()
        fits = file.parent.is_dir() and (file.is_file() or not file.exists())
    except (OSError, RuntimeError, ValueError):  # a name that is too long, of an unknown user, or no name at all
        fits = False
    if not fits:
        raise RegionError(f"path = {path!r} is not allowed; allowed: a file in a folder that exists")
    return file


def _saved(region_map: BuiltMap, path: Path) -> str:
    """Save a map that is published already; its path."""
    try:
        region_map.save(path)
    except RegionError as problem:
        raise RegionError(f"{problem}; the map is on {topics.REGION_MAP}") from None
    return str(path)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(RegionMonitorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
