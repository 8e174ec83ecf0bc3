"""Node `identifier`: models of the plant from the last experiment or from a bag, and their validation.

The computations run in workers. Meanwhile the node receives telemetry and answers its other services.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Literal, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.analysis import RecordedLoop, read_loop
from amb_core.errors import AmbError, BagError, IdentificationError, ParameterError
from amb_core.files.parameter_files import BRIDGE_NODE, CONTROLLERS
from amb_core.identification import (
    Focus,
    Identification,
    IdentificationProgress,
    Method,
    StateSpaceModel,
    identify,
    validate,
)
from amb_core.identification.controller_choice import ALLOWED, is_named_set, named_controller, needs_controller
from amb_core.identification.data.drift import DriftOption
from amb_core.identification.identify import check_arguments
from amb_core.loop.control import ControllerParameters
from amb_core.loop.experiments import controller_of_bridge, linear_controller_of
from amb_core.loop.known_controller import KnownController
from amb_core.parameters import Parameters, choice, part_of, quantity
from amb_core.plant import PlantParameters
from amb_core.recording.messages.excitation_status import answer_from_message
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.state_space_model import fill_model, model_from_message
from amb_ident_node.listening import LiveExperiment
from amb_msgs import action, msg, srv
from amb_ros import diagnostics, topics
from amb_ros.actions import create_action
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.services import create_service
from amb_ros.subscriptions import create_subscription

NAME_A_CONTROLLER = f"name it in `controller`: {ALLOWED}, or a running node"

DEFAULT_FOCUS: Focus = "prediction"

P = TypeVar("P", bound=Parameters)


class IdentifierParameters(Parameters):
    """Parameters of the node."""

    order: int = quantity(10, "-", "number of states if a request gives none", 1, 40)
    method: Method = choice("pem", "method if a request gives none")
    drift: DriftOption = choice(
        "auto", "slow drift of the outputs: auto (removed where the checks find it), none, or prefilter (always)"
    )
    max_steps: int = quantity(
        1_200_000, "-", "steps of telemetry that are kept; older ones are dropped", 1_000, 100_000_000
    )
    controller: str = choice("pd_controller", "node whose parameters describe the controller, relative or full name")
    simulator: str = choice("simulator", "node whose parameters describe the plant, if there is one")
    parameter_timeout: float = quantity(1.0, "s", "longest wait for the parameters of either", 0.05, 10.0)


class IdentifierNode(Node):
    """The identifier. Topics, services, actions and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("identifier", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._settings = declare(self, IdentifierParameters)
        self._live = LiveExperiment(self._settings.max_steps)
        self._malformed = 0
        self._identification: Identification | None = None
        self._model: msg.StateSpaceModel | None = None  # of the last identification, as it was published
        self._models = 0  # published
        self._stage = ""  # of the identification in progress
        self._ending = threading.Event()
        self._remote_parameters = RemoteParameters(self)
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="identifier")
        self._validator = ThreadPoolExecutor(1, thread_name_prefix="validator")
        self._publisher = self.create_publisher(msg.StateSpaceModel, topics.MODEL, LATCHED)
        self._telemetry_subscription = create_subscription(
            self, msg.LoopSamples, topics.TELEMETRY, self._on_telemetry, HISTORY
        )
        self._status_subscription = create_subscription(
            self, msg.ExcitationStatus, topics.EXCITATION_STATUS, self._on_excitation_status, EVERY_STATE
        )
        create_service(self, srv.Identify, "~/identify", self._on_identify, self._worker)
        create_service(self, srv.GetModel, "~/get_model", self._on_get_model)
        create_service(self, srv.Validate, "~/validate", self._on_validate, self._validator)
        self._published: msg.StateSpaceModel | None = None  # the last linear controller
        self._controller_subscription = create_subscription(
            self, msg.StateSpaceModel, topics.CONTROLLER, self._on_controller, LATCHED
        )
        self._action = create_action(
            self, action.Identify, "~/identify", self._on_identify_goal, self._worker, self._check_request
        )
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report, exclusive=(topics.TELEMETRY,))

    def destroy_node(self) -> None:
        """Cancel the work in progress, without waiting for it, and end the node."""
        self._ending.set()
        for worker in (self._worker, self._validator):
            worker.shutdown(wait=False, cancel_futures=True)
        self._action.destroy()
        super().destroy_node()

    # -- topics

    def _on_telemetry(self, message: msg.LoopSamples) -> None:
        try:
            self._live.add_block(message.run, block_from_message(message))
        except BagError as problem:
            self._malformed += 1
            self.get_logger().error(str(problem), throttle_duration_sec=5.0)

    def _on_excitation_status(self, message: msg.ExcitationStatus) -> None:
        self._live.add_excitation(answer_from_message(message))

    # -- services and the action

    def _on_identify(self, request: srv.Identify.Request, response: srv.Identify.Response) -> srv.Identify.Response:
        self._identify(request, response, lambda _: None, self._ending.is_set)
        return response

    def _on_identify_goal(
        self,
        goal: action.Identify.Goal,
        feedback: Callable[[action.Identify.Feedback], None],
        cancelled: Callable[[], bool],
    ) -> action.Identify.Result:
        def tell(progress: IdentificationProgress) -> None:
            cost = math.nan if progress.cost is None else progress.cost
            feedback(
                action.Identify.Feedback(stage=progress.stage, done=progress.done, total=progress.total, cost=cost)
            )

        result = action.Identify.Result()
        self._identify(goal, result, tell, lambda: cancelled() or self._ending.is_set())
        return result

    def _on_get_model(self, _: srv.GetModel.Request, response: srv.GetModel.Response) -> srv.GetModel.Response:
        if self._model is None:
            raise IdentificationError("no model has been identified yet; call ~/identify first")
        response.success = True
        response.model = self._model
        return response

    def _on_validate(self, request: srv.Validate.Request, response: srv.Validate.Response) -> srv.Validate.Response:
        if request.model:
            model, uncertainty = StateSpaceModel.load(request.model), None
        elif self._identification is not None:
            model, uncertainty = self._identification.model, self._identification.uncertainty
        else:
            raise IdentificationError("no model has been identified yet; call ~/identify first or name a file")
        self._check_sources(request)
        loop, remark = self._loop(request, with_plant=True)
        found = validate(model, loop.data, loop.controller, uncertainty=uncertainty, plant=loop.plant)
        response.success = True
        response.message = found.summary + remark
        response.report = found.report()
        response.validated = found.validated
        response.fit = found.fit.tolist()
        response.one_step_fit = found.one_step_fit.tolist()
        response.white = found.white
        response.independent = found.independent
        response.closed_loop_stable = bool(found.closed_loop_stable)
        response.unstable_poles = len(model.unstable_poles())
        return response

    # -- in the workers

    def _identify(
        self, request: Any, answer: Any, progress: Callable[[IdentificationProgress], None], ended: Callable[[], bool]
    ) -> None:
        """Identify according to a request of the service or the action, and fill in its response or result."""

        def tell(told: IdentificationProgress) -> None:
            self._stage = f"{told.stage}, {told.done} of {told.total}"
            progress(told)

        self._check_request(request)
        loop, remark = self._loop(request)
        try:
            result = identify(
                loop.data,
                *self._arguments(request),
                loop.controller,
                focus=request.focus or DEFAULT_FOCUS,
                drift=self._settings.drift,
                progress=tell,
                cancelled=ended,
            )
        finally:
            self._stage = ""
        message = fill_model(msg.StateSpaceModel(), result.model)
        message.header.stamp = self._wall_clock.now().to_msg()
        self._models += 1
        message.sequence = self._models
        self._identification, self._model = result, message
        self._publisher.publish(message)
        answer.success = True
        answer.message = result.summary + remark
        answer.warnings = [f"{finding.check}: {finding.text}" for finding in result.report.warnings]
        answer.model = message
        self.get_logger().info(answer.message)

    def _check_request(self, request: Any) -> None:
        """Refuse a request of the service or the action that no data can serve, without reading any."""
        if request.auto_order and request.order:
            raise IdentificationError(f"order = {request.order} is not allowed with auto_order; allowed: 0")
        order, method = self._arguments(request)
        check_arguments(order, method, request.focus or DEFAULT_FOCUS)
        self._check_sources(request)

    def _check_sources(self, request: Any) -> None:
        """Refuse impossible steps, a bag that does not exist, and an invalid parameter file."""
        if request.first_step < -1:
            raise IdentificationError(f"first_step = {request.first_step} is not allowed; allowed: -1 or more")
        if request.bag and not os.path.exists(request.bag):  # noqa: PTH110  # Path.exists raises on long names
            raise BagError(f"bag {request.bag}: there is no such file or folder")
        if is_named_set(request.controller):
            self._named_controller(request.controller, None)

    def _arguments(self, request: Any) -> tuple[int | Literal["auto"], str]:
        """Requested order and method."""
        order: int | Literal["auto"] = "auto" if request.auto_order else request.order or self._settings.order
        return order, request.method or self._settings.method

    def _loop(self, request: Any, with_plant: bool = False) -> tuple[RecordedLoop, str]:
        """The requested data, from a bag or from the current run, and a remark on them.

        Raises
        ------
        BagError, IdentificationError
            If there are no such data, or their controller is not known.
        ParameterError
            If the parameters of the requested controller are not available.
        """
        if request.bag:
            named = request.controller if is_named_set(request.controller) else ""
            loop = read_loop(request.bag, named, first_step=request.first_step, steps=request.steps)
        else:
            data = self._live.data(request.first_step, request.steps)
            running = None if request.controller else self._running_controller(data.sample_rate)
            loop = RecordedLoop(
                data,
                running,
                self._read(PlantParameters, self._settings.simulator) if with_plant else None,
            )
        remark = f"; bag is truncated: {loop.damage}" if loop.damage else ""
        if request.controller:
            if not (request.bag and is_named_set(request.controller)):
                loop = replace(loop, controller=self._named_controller(request.controller, loop.data.sample_rate))
            remark += f"; controller: {request.controller}, as requested"
        elif loop.controller is None and needs_controller(loop.data):
            source = f"bag {request.bag} lacks" if request.bag else f"node {self._settings.controller} does not give"
            raise IdentificationError(f"{source} the parameters of the controller; {NAME_A_CONTROLLER}")
        return loop, remark

    def _named_controller(self, name: str, sample_rate: float | None) -> KnownController:
        """The controller named in a request, at the sample rate of its data (Hz) if that is known."""
        if is_named_set(name):
            return named_controller(name, self._settings.controller.rsplit("/", 1)[-1], sample_rate)
        found = self._controller_of(name)
        return found if sample_rate is None else found.at_rate(sample_rate)

    def _running_controller(self, sample_rate: float) -> KnownController | None:
        """The controller of the running loop; None if there is none that reports its parameters.

        That of the node in the parameter `controller` or, if it does not run, that of another node that closes a loop.
        """
        names = [self._settings.controller]
        running = {name.rsplit("/", 1)[-1] for name in self._remote_parameters.nodes()}
        others = [name for name in (*CONTROLLERS, BRIDGE_NODE) if name in running]
        if names[0] in CONTROLLERS and names[0] not in running and others:
            names = others[:1]
        try:
            return self._controller_of(names[0]).at_rate(sample_rate)
        except AmbError as problem:
            self.get_logger().warning(str(problem))
            return None

    def _controller_of(self, node: str) -> KnownController:
        """The controller of a running node: the PD law, or the linear one that it has taken.

        Raises
        ------
        AmbError
            If the node does not report its parameters, or has no controller.
        """
        values = self._remote_parameters.read_all(node, self._settings.parameter_timeout)
        if "controller_file" not in values:
            return part_of(ControllerParameters, values)
        if node.rsplit("/", 1)[-1] == BRIDGE_NODE:
            return controller_of_bridge(values, None)
        published = None if self._published is None else model_from_message(self._published)
        found = linear_controller_of(values, published)
        if found is None:
            raise ParameterError(f"node {node} has no controller yet")
        return found

    def _on_controller(self, message: msg.StateSpaceModel) -> None:
        self._published = message

    def _read(self, parameters: type[P], node: str) -> P | None:
        """Parameters of a running node; None if it does not report them."""
        try:
            return self._remote_parameters.read_set(parameters, node, self._settings.parameter_timeout)
        except ParameterError as problem:
            self.get_logger().warning(str(problem))
            return None

    # -- health

    def _report(self) -> diagnostics.Report:
        first, stop = self._live.available
        values = {
            "run": self._live.run,
            "first step": first,
            "steps": stop - first,
            "malformed blocks": self._malformed,
            "identification": self._stage or "none in progress",
        }
        if self._live.conflict:
            return diagnostics.ERROR, self._live.conflict, values
        if self._malformed:
            return diagnostics.WARN, f"{self._malformed} malformed blocks of telemetry", values
        return diagnostics.OK, "listening", values


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(IdentifierNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
