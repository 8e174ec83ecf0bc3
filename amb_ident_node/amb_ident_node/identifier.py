"""Node `identifier`: models of the plant from the last experiment or from a bag, as services.

The computation runs in a worker; meanwhile the node goes on listening and answers `get_model`.
"""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from amb_core.bags import read_bag
from amb_core.control import ControllerParameters
from amb_core.errors import BagError, IdentificationError, ParameterError
from amb_core.experiments import ExperimentBuffer, select_window
from amb_core.identification import Identification, Method, identify
from amb_core.messages import block_from_message, excitation_from_message
from amb_core.parameters import Parameters, choice, quantity
from amb_core.records import LoopRecord
from amb_msgs.msg import ExcitationStatus, LoopSamples, StateSpaceModel
from amb_msgs.srv import GetModel, Identify
from amb_ros import diagnostics, topics
from amb_ros.models import model_to_message
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import EVERY_STATE, HISTORY, LATCHED
from amb_ros.remote_parameters import RemoteParameters
from amb_ros.services import create_service

QUIET = 0.2  # s; telemetry of a run that has just ended may still be under way: as long as nothing comes, it is not
LONGEST_ARRIVAL = 2.0  # s
ASSUMED_CONTROLLER = "controller parameters unknown, the paper's assumed"


class IdentifierParameters(Parameters):
    """Parameters of the node."""

    order: int = quantity(10, "-", "number of states where a request names none", 1, 30)
    method: Method = choice("pem", "method where a request names none")
    max_steps: int = quantity(
        1_200_000, "-", "steps of telemetry that are kept; older ones are dropped", 1_000, 100_000_000
    )
    controller: str = choice("pd_controller", "node whose parameters describe the controller, relative or full name")
    parameter_timeout: float = quantity(1.0, "s", "longest wait for the parameters of the controller", 0.05, 10.0)


class IdentifierNode(Node):
    """The identifier. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__("identifier", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True)
        self._settings = declare(self, IdentifierParameters)
        self._live = ExperimentBuffer(self._settings.max_steps)
        self._arrived = threading.Condition()
        self._malformed = 0
        self._model: StateSpaceModel | None = None
        self._remote_parameters = RemoteParameters(self)
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="identifier")
        self._publisher = self.create_publisher(StateSpaceModel, topics.MODEL, LATCHED)
        self._telemetry_subscription = self.create_subscription(
            LoopSamples, topics.TELEMETRY, self._on_telemetry, HISTORY
        )
        self._status_subscription = self.create_subscription(
            ExcitationStatus, topics.EXCITATION_STATUS, self._on_excitation_status, EVERY_STATE
        )
        create_service(self, Identify, "~/identify", self._on_identify, self._worker)
        create_service(self, GetModel, "~/get_model", self._on_get_model)
        self._diagnostics = diagnostics.DiagnosticsReporter(self, self._report)

    def destroy_node(self) -> None:
        """End the computation under way, then the node."""
        self._worker.shutdown(cancel_futures=True)
        super().destroy_node()

    # -- topics

    def _on_telemetry(self, message: LoopSamples) -> None:
        try:
            block = block_from_message(message)
        except BagError as problem:
            self._malformed += 1
            self.get_logger().error(str(problem), throttle_duration_sec=5.0)
            return
        self._live.add_block(message.run, block)
        with self._arrived:
            self._arrived.notify_all()

    def _on_excitation_status(self, message: ExcitationStatus) -> None:
        self._live.add_excitation(excitation_from_message(message))

    # -- services

    def _on_identify(self, request: Identify.Request, response: Identify.Response) -> Identify.Response:
        if request.bag:
            bag = read_bag(request.bag)
            record = bag.experiment(request.first_step, request.steps)
            controller = bag.controller_parameters()
            source = str(bag.path)
            remark = f"; bag is truncated: {bag.truncated}" if bag.truncated else ""
        else:
            record, source = self._live_record(request)
            controller = self._live_controller()
            remark = ""
        result = self._identify(request, record, controller, source)
        self._model = model_to_message(result.model, self._wall_clock.now().to_msg())
        self._publisher.publish(self._model)
        response.success = True
        response.message = result.summary + remark + ("" if controller else f"; {ASSUMED_CONTROLLER}")
        response.model = self._model
        self.get_logger().info(response.message)
        return response

    def _on_get_model(self, _request: GetModel.Request, response: GetModel.Response) -> GetModel.Response:
        if self._model is None:
            raise IdentificationError("no model has been identified yet; call ~/identify first")
        response.success = True
        response.model = self._model
        return response

    # -- work of the worker

    def _identify(
        self, request: Identify.Request, record: LoopRecord, controller: ControllerParameters | None, source: str
    ) -> Identification:
        order = request.order or self._settings.order
        method = request.method or self._settings.method
        return identify(record, order, method, controller, source)

    def _live_record(self, request: Identify.Request) -> tuple[LoopRecord, str]:
        """The samples asked for of the current run, and what to call them."""
        self._wait_for_arrival()
        run = self._live.run
        if run is None:
            topic = self.resolve_topic_name(topics.TELEMETRY)
            raise IdentificationError(f"no telemetry heard on {topic} yet; run an experiment first or name a bag")
        window = select_window(self._live.available, self._live.experiment, request.first_step, request.steps)
        return self._live.record(*window), f"run {run}, steps {window[0]} to {window[1] - 1}"

    def _wait_for_arrival(self) -> None:
        """Wait until the telemetry of the last experiment is there, or until no more comes."""
        deadline = time.monotonic() + LONGEST_ARRIVAL
        with self._arrived:
            while time.monotonic() < deadline:
                experiment = self._live.experiment
                if experiment is not None and self._live.available[1] >= experiment[1]:
                    return
                if not self._arrived.wait(QUIET) and self._live.run is not None:
                    return

    def _live_controller(self) -> ControllerParameters | None:
        try:
            return self._remote_parameters.read_set(
                ControllerParameters, self._settings.controller, self._settings.parameter_timeout
            )
        except ParameterError as problem:
            self.get_logger().warning(f"{problem}; {ASSUMED_CONTROLLER}")
            return None

    # -- health

    def _report(self) -> diagnostics.Report:
        first, stop = self._live.available
        values = {
            "run": self._live.run,
            "first step": first,
            "steps": stop - first,
            "malformed blocks": self._malformed,
        }
        if self._malformed:
            return diagnostics.WARN, f"{self._malformed} malformed blocks of telemetry", values
        return diagnostics.OK, "listening", values


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(IdentifierNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
