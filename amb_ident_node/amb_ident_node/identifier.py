"""Node `identifier`: models of the plant from the last experiment or from a bag, and their validation.

The computations run in workers. Meanwhile the node receives telemetry and answers its other services.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.ground.errors import BagError, IdentificationError, one_line
from amb_core.ground.plain_text import plain_text
from amb_core.identification import Focus, IdentificationProgress, StateSpaceModel, identify, validate
from amb_core.identification.identify import check_arguments
from amb_core.recording.messages.excitation_status import answer_from_message
from amb_core.recording.messages.loop_samples import block_from_message
from amb_core.recording.messages.state_space_model import fill_model
from amb_ident_node.identified import Identified
from amb_ident_node.identifier_parameters import IdentifierParameters
from amb_ident_node.listening import LiveExperiment
from amb_ident_node.sources import LoopSources
from amb_msgs import action, msg, srv
from amb_ros import diagnostics, topics
from amb_ros.actions import create_action
from amb_ros.alarms import RecentProblem
from amb_ros.message_texts import with_plain_texts
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED
from amb_ros.services import create_service
from amb_ros.subscriptions import create_subscription

DEFAULT_FOCUS: Focus = "prediction"


class IdentifierNode(Node):
    """The identifier. Topics, services, actions and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("identifier", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._settings = declare(self, IdentifierParameters)
        self._live = LiveExperiment(self._settings.max_steps)
        self._malformed = 0
        self._malformed_lately = RecentProblem()
        self._identified: Identified | None = None  # the last identification
        self._model: msg.StateSpaceModel | None = None  # of the last identification, as it was published
        self._models = 0  # published
        self._stage = ""  # of the identification in progress
        self._ending = threading.Event()
        names = self._settings
        self._sources = LoopSources(self, self._live, names.controller, names.simulator, names.parameter_timeout)
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
        create_service(self, srv.Certify, "~/certify", self._on_certify, self._validator)
        self._action = create_action(
            self, action.Identify, "~/identify", self._on_identify_goal, self._worker, self._check_request
        )
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report, exclusive=(topics.TELEMETRY,))

    def finish(self) -> None:
        """Cancel the work in progress, without waiting for it."""
        self._ending.set()
        for worker in (self._worker, self._validator):
            worker.shutdown(wait=False, cancel_futures=True)
        self._action.destroy()

    # -- topics

    def _on_telemetry(self, message: msg.LoopSamples) -> None:
        try:
            self._live.add_block(message.run, block_from_message(message))
        except BagError as problem:
            self._malformed += 1
            if self._malformed_lately.note(one_line(problem)):
                self._diagnostics.publish()
            self.get_logger().error(one_line(problem), throttle_duration_sec=5.0)

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
        def publish(progress: IdentificationProgress) -> None:
            cost = math.nan if progress.cost is None else progress.cost
            feedback(
                action.Identify.Feedback(stage=progress.stage, done=progress.done, total=progress.total, cost=cost)
            )

        result = action.Identify.Result()
        self._identify(goal, result, publish, lambda: cancelled() or self._ending.is_set())
        return result

    def _on_get_model(self, _: srv.GetModel.Request, response: srv.GetModel.Response) -> srv.GetModel.Response:
        if self._model is None:
            raise IdentificationError("no model has been identified yet; call ~/identify first")
        response.success = True
        response.model = self._model
        return response

    def _on_validate(self, request: srv.Validate.Request, response: srv.Validate.Response) -> srv.Validate.Response:
        if request.model:
            model, uncertainty, search = StateSpaceModel.load(request.model), None, None
        elif (identified := self._identified) is not None:
            result = identified.result
            model, uncertainty, search = result.model, result.uncertainty, result.search
        else:
            raise IdentificationError("no model has been identified yet; call ~/identify first or name a file")
        self._sources.check(request)
        loop, remark = self._sources.loop(request, with_plant=True)
        validation = validate(
            model, loop.data, loop.controller, uncertainty=uncertainty, plant=loop.plant, search=search
        )
        response.success = True
        response.message = validation.summary + remark
        response.report = validation.report()
        response.verdict, response.validated = validation.verdict.code, validation.validated
        response.fit = validation.fit.tolist()
        response.one_step_fit = validation.one_step_fit.tolist()
        response.white = validation.white
        response.independent = validation.independent
        response.closed_loop_stable = bool(validation.closed_loop_stable)
        response.unstable_poles = len(model.unstable_poles())
        return response

    def _on_certify(self, request: srv.Certify.Request, response: srv.Certify.Response) -> srv.Certify.Response:
        from amb_ident_node.certification import Certifier  # most identifiers never certify

        return Certifier(self._sources).certify(request, response, self._identified)

    # -- in the workers

    def _identify(
        self, request: Any, answer: Any, progress: Callable[[IdentificationProgress], None], ended: Callable[[], bool]
    ) -> None:
        """Identify according to a request of the service or the action, and fill in its response or result."""

        def note(state: IdentificationProgress) -> None:
            self._stage = f"{state.stage}, {state.done} of {state.total}"
            progress(state)

        self._check_request(request)
        loop, remark = self._sources.loop(request)
        try:
            result = identify(
                loop.data,
                *self._arguments(request),
                loop.controller,
                focus=request.focus or DEFAULT_FOCUS,
                drift=self._settings.drift,
                progress=note,
                cancelled=ended,
            )
        finally:
            self._stage = ""
        message = with_plain_texts(fill_model(msg.StateSpaceModel(), result.model))
        message.header.stamp = self._wall_clock.now().to_msg()
        self._models += 1
        message.sequence = self._models
        self._identified, self._model = Identified(result, loop), message
        self._publisher.publish(message)
        answer.success, answer.verdict = True, result.verdict.code
        answer.message = result.summary + remark
        answer.warnings = [f"{finding.check}: {finding.text}" for finding in result.report.warnings]
        answer.model = message
        self.get_logger().info(plain_text(answer.message))

    def _check_request(self, request: Any) -> None:
        """Refuse a request of the service or the action that no data can serve, without reading any."""
        if request.auto_order and request.order:
            raise IdentificationError(f"order = {request.order} is not allowed with auto_order; allowed: 0")
        order, method = self._arguments(request)
        check_arguments(order, method, request.focus or DEFAULT_FOCUS)
        self._sources.check(request)

    def _arguments(self, request: Any) -> tuple[int | Literal["auto"], str]:
        """Requested order and method."""
        order: int | Literal["auto"] = "auto" if request.auto_order else request.order or self._settings.order
        return order, request.method or self._settings.method

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
        if malformed := self._malformed_lately.text:
            return diagnostics.WARN, malformed, values
        return diagnostics.OK, "listening", values


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(IdentifierNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
