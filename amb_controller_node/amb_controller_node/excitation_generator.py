"""Node `excitation_generator`: the excitations of amb_core as a service, and their prediction from a region map.

A request is checked and published as a definition. The controller makes the samples from it, and the checksum shows
that they are the same. The response waits for the controller's answer: only the controller knows the next step.

The topic is latched: a controller that starts later takes what was published last. So a start that fails takes back
what it published, and a stop does not wait for starts: it calls off every one that arrived before it. Stops that wait
are answered together, since a client asks again.
"""

from __future__ import annotations

import secrets
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node

from amb_controller_node.parameters import GeneratorParameters
from amb_core.excitation import Excitation as ExcitationParameters
from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import ExcitationError, ParameterError, RegionError
from amb_core.ground.parameters import Parameters
from amb_core.loop.machine import Machine
from amb_core.recording.messages.excitation import fill_excitation
from amb_msgs.msg import BridgeState, Excitation, ExcitationStatus, SimulatorState
from amb_msgs.msg import RegionMap as RegionMapMessage
from amb_msgs.srv import PreviewExcitation, StartExcitation, StopExcitation
from amb_ros import diagnostics, topics
from amb_ros.excitation_messages import HIGHEST_STEP, STOP
from amb_ros.machine import MachineInput
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, LATCHED
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.services import create_service
from amb_ros.subscriptions import create_subscription

if TYPE_CHECKING:
    from amb_core.regions.region_map import RegionMap

P = TypeVar("P", bound=Parameters)

CONTROLLER_SLOWNESS = 5.0  # longest time of a controller for the samples, relative to the time of the generator

HIGHEST_FIRST_ID = 2**31
"""Ids count from anywhere below it: answers to a generator before this one, which stay on their topic and in bags, are
of other ids then."""

DELIVERY = Duration(seconds=1)  # longest wait until an excitation has arrived everywhere
CALLED_OFF = "called off by a stop"
REQUEST_FIELDS = [
    name for name in StartExcitation.Request.get_fields_and_field_types() if name not in ("kind", "run", "first_step")
]


class ExcitationGeneratorNode(Node):
    """The generator. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__(
            "excitation_generator", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        self._settings = declare(self, GeneratorParameters)
        self._run = 0
        self._run_known = threading.Event()
        self._publishing = threading.Lock()  # of id, stops, open stop, awaited, starting and active
        self._first_id = self._id = secrets.randbelow(HIGHEST_FIRST_ID)
        self._stops = 0  # requests to stop that have arrived
        self._open_stop: Future[str] | None = None  # why it failed; None also once an excitation has followed it
        self._awaited: dict[int, Future[ExcitationStatus]] = {}
        self._starting: Future[ExcitationStatus] | None = None  # the answer that a start awaits
        self._active: Excitation | None = None  # the last one that was accepted, until a stop
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._publisher = self.create_publisher(Excitation, topics.EXCITATION, LATCHED)
        self._status_subscription = create_subscription(
            self, ExcitationStatus, topics.EXCITATION_STATUS, self._on_status, EVERY_STATE
        )
        self._state_subscription = create_subscription(
            self, SimulatorState, topics.SIMULATOR_STATE, self._on_state, LATCHED
        )
        self._bridge_subscription = create_subscription(self, BridgeState, topics.BRIDGE_STATE, self._on_state, LATCHED)
        self._last_map: RegionMapMessage | None = None
        self._map_subscription = create_subscription(
            self, RegionMapMessage, topics.REGION_MAP, self._on_region_map, LATCHED
        )
        self._machine_input = MachineInput(self)
        self._remote_parameters = RemoteParameters(self)
        starter, stopper, previewer = (
            ThreadPoolExecutor(1, thread_name_prefix=name) for name in ("start", "stop", "preview")
        )
        create_service(self, StartExcitation, "~/start", self._on_start, starter, lambda _request: (self._stops,))
        create_service(self, StopExcitation, "~/stop", self._on_stop, stopper, self._on_stop_arrival)
        create_service(self, PreviewExcitation, "~/preview", self._on_preview, previewer)
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report, exclusive=(topics.EXCITATION_STATUS,))

    def _on_start(
        self, request: StartExcitation.Request, response: StartExcitation.Response, stops: int
    ) -> StartExcitation.Response:
        excitation = self._excitation(request)
        if request.first_step < Excitation.FROM_NEXT_STEP:
            raise ExcitationError(
                f"first_step = {request.first_step} is not allowed; allowed: 0 or more, or "
                f"{Excitation.FROM_NEXT_STEP} for the next step"
            )
        run = request.run or self._current_run()
        started = time.monotonic()
        message = self._message(excitation, run, request.first_step)
        # The controller makes the same samples while it answers the loop.
        longer_by = CONTROLLER_SLOWNESS * (time.monotonic() - started)
        status = self._start(message, stops, self._settings.answer_timeout + longer_by)
        response.success = True
        response.run = status.run
        response.first_step = status.first_step
        response.steps = status.steps
        return response

    def _on_stop_arrival(self, _request: StopExcitation.Request) -> tuple[Future[str]]:
        """Call off the starts that arrived before a stop; it is one with a stop that is not answered yet."""
        with self._publishing:
            self._stops += 1
            if self._starting is not None and not self._starting.done():
                self._starting.set_exception(ExcitationError(CALLED_OFF))
            if self._open_stop is None:
                self._open_stop = Future()
            return (self._open_stop,)

    def _on_stop(
        self, _request: StopExcitation.Request, response: StopExcitation.Response, stop: Future[str]
    ) -> StopExcitation.Response:
        if not stop.done():
            problem = ""
            try:
                self._carry_out_stop()
            except ExcitationError as refusal:
                problem = str(refusal)
            with self._publishing:
                if self._open_stop is stop:
                    self._open_stop = None
                stop.set_result(problem)
        if problem := stop.result():
            raise ExcitationError(problem)
        response.success = True
        return response

    def _carry_out_stop(self) -> None:
        message = _stop(self._current_run())
        with self._publishing:
            answer = self._publish(message)
        status = self._answer_to(message, answer, self._settings.answer_timeout)
        if not status.accepted:
            raise ExcitationError(status.message)
        self._keep(message, status)

    def _on_preview(
        self, request: PreviewExcitation.Request, response: PreviewExcitation.Response
    ) -> PreviewExcitation.Response:
        # Imported here: a generator that only starts excitations does not need it.
        from amb_core.designs.excitation import check_excitation
        from amb_core.designs.excitation.notes import made_with
        from amb_core.loop.pd_parameters import ControllerParameters
        from amb_core.plant import PlantParameters
        from amb_core.regions import Region

        notes: list[str] = []
        excitation, region_map, machine = self._excitation(request), self._region_map(request.map), self._machine_input
        controller = self._live_set(ControllerParameters, self._settings.controller, notes)
        of_map = made_with(region_map, "controller", ControllerParameters).sample_rate
        sample_rate = of_map if machine.machine is None else machine.machine.sample_rate
        check = check_excitation(
            generate(excitation, sample_rate, machine.machine),
            region_map,
            controller and controller.at_rate(sample_rate),
            self._live_set(PlantParameters, self._settings.simulator, notes),
        )
        response.success = True
        response.message = check.verdict
        response.notes = [*check.notes, *notes]
        response.region = int(check.predicted)
        response.certain = check.certain
        response.margin = check.margin
        for axis in check.axes:
            setattr(response, f"region_{axis.axis}", int(axis.predicted))
            setattr(response, f"power_{axis.axis}", [axis.shares[region] for region in Region])
            setattr(response, f"crest_factor_{axis.axis}", axis.crest_factor)
        return response

    def _excitation(self, request: StartExcitation.Request | PreviewExcitation.Request) -> ExcitationParameters:
        """The requested excitation."""
        return excitation_from_request(request.kind, {name: getattr(request, name) for name in REQUEST_FIELDS})

    def _region_map(self, path: str) -> RegionMap:
        """The map of a file, or the last one that the region monitor has built."""
        if path:
            from amb_core.regions.region_map import RegionMap

            return RegionMap.load(path)
        if self._last_map is None:
            raise RegionError(
                f"no region map received on {self._map_subscription.topic_name}; call region_monitor/build_map first, "
                "or name the file of a map"
            )
        from amb_core.recording.messages.region_map import region_map_from_message

        return region_map_from_message(self._last_map)

    def _live_set(self, model: type[P], node: str, notes: list[str]) -> P | None:
        """Parameters of the running loop, None (for those of the map) if its node does not report them."""
        try:
            return self._remote_parameters.read_set(model, node, self._settings.parameter_timeout)
        except ParameterError as problem:
            notes.append(f"{problem}; those of the map are assumed")
            return None

    def _message(self, excitation: ExcitationParameters, run: int, first_step: int) -> Excitation:
        """The definition of an excitation, with number and checksum of its samples; the samples are not kept."""
        machine = self._machine()
        return fill_excitation(Excitation(), excitation, run, first_step, machine.sample_rate, machine)

    def _machine(self) -> Machine:
        return self._machine_input.wait(self._settings.answer_timeout)

    def _current_run(self) -> int:
        timeout = self._settings.answer_timeout
        if not self._run_known.wait(timeout):
            raise ExcitationError(
                f"no message within {timeout:g} s on {self._state_subscription.topic_name} with the current run; "
                "is the simulator running? On a rig a run begins with levitation. Or give the run in the request"
            )
        return self._run

    def _start(self, message: Excitation, stops: int, timeout: float) -> ExcitationStatus:
        """Publish an excitation and return the controller's answer; take it back if there is none within a time (s).

        Raises
        ------
        ExcitationError
            If no controller answers in time, it refuses, or more stops have arrived than the given number.
        """
        with self._publishing:
            if self._stops != stops:
                raise ExcitationError(CALLED_OFF)
            answer = self._starting = self._publish(message)
        try:
            status = self._answer_to(message, answer, timeout)
        except ExcitationError:
            self._replace(message, _stop(message.run))  # a controller may have taken it without a timely answer
            raise
        if not status.accepted:
            self._replace(message, self._active or _stop(message.run))
            raise ExcitationError(status.message)
        self._keep(message, status)
        return status

    def _publish(self, message: Excitation) -> Future[ExcitationStatus]:
        """Publish an excitation under the next id; its answer. While `_publishing` is held."""
        self._id += 1
        message.id = self._id
        message.header.stamp = self._wall_clock.now().to_msg()
        if message.kind == STOP:
            self._active = None  # answered or not: nobody may take up again what it has ended
        else:
            self._open_stop = None  # stops that arrive from now on are to end this one
        answer = self._awaited[self._id] = Future()
        self._publisher.publish(message)
        return answer

    def _answer_to(self, message: Excitation, answer: Future[ExcitationStatus], timeout: float) -> ExcitationStatus:
        try:
            return answer.result(timeout)
        except TimeoutError:
            raise ExcitationError(
                f"no answer within {timeout:g} s from a controller on {self._publisher.topic_name} "
                f"({self._publisher.get_subscription_count()} listening); is the controller running?"
            ) from None
        finally:
            with self._publishing:
                del self._awaited[message.id]

    def _keep(self, message: Excitation, status: ExcitationStatus) -> None:
        """Publish an accepted excitation again with its step resolved, for controllers and recorders that join later.

        Not if another one has been published meanwhile, which would be taken back by that.
        """
        with self._publishing:
            if message.id != self._id:
                return
            if message.kind != STOP:
                self._active = message
            if message.first_step != status.first_step:
                message.first_step = status.first_step
                self._publisher.publish(message)

    def _replace(self, failed: Excitation, former: Excitation) -> None:
        """Take back an excitation: publish a stop, or the one before it, which goes on meanwhile."""
        self._publisher.wait_for_all_acked(DELIVERY)  # the topic keeps one message only
        with self._publishing:
            if failed.id == self._id:
                if former.id == 0:
                    self._publish(former)
                    del self._awaited[former.id]
                else:
                    self._publisher.publish(former)

    def _on_status(self, message: ExcitationStatus) -> None:
        with self._publishing:
            if message.kind == STOP and message.accepted and self._active and message.run == self._active.run:
                self._active = None  # by whomever: a user's own node, or the bridge itself
            answer = self._awaited.get(message.id)
            # A later first step is not one of a controller: the generator asks for none.
            if answer is not None and not answer.done() and message.first_step <= HIGHEST_STEP:
                answer.set_result(message)

    def _report(self) -> diagnostics.Report:
        values = {"run": self._run, "excitations": self._id - self._first_id}
        if self._machine_input.problem:
            return diagnostics.WARN, self._machine_input.problem, values
        return diagnostics.OK, "ready", values

    def _on_region_map(self, message: RegionMapMessage) -> None:
        self._last_map = message

    def _on_state(self, message: SimulatorState | BridgeState) -> None:
        if message.run:  # a bridge has none before the first levitation
            self._run = message.run
            self._run_known.set()


def _stop(run: int) -> Excitation:
    return Excitation(run=run, kind=STOP, first_step=Excitation.FROM_NEXT_STEP)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(ExcitationGeneratorNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
