"""Node `excitation_generator`: the excitations of amb_core as a service.

A request is checked, its samples are generated and published for the controller, and the answer waits for the
controller's word: only the controller knows which step is still to come.
"""

from __future__ import annotations

import json
from array import array

from amb_msgs.msg import Excitation, ExcitationStatus, SimulatorState
from amb_msgs.srv import StartExcitation, StopExcitation
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from amb_controller_node.parameters import GeneratorParameters
from amb_core.errors import AmbError, ExcitationError
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_ros import topics
from amb_ros.parameters import declare
from amb_ros.process import run_node
from amb_ros.qos import LATCHED

REQUEST_FIELDS = [
    name for name in StartExcitation.Request.get_fields_and_field_types() if name not in ("kind", "run", "first_step")
]


class ExcitationGeneratorNode(Node):
    """The generator. Topics, services and parameters: see the package's README."""

    def __init__(self) -> None:
        super().__init__(
            "excitation_generator", namespace=topics.NAMESPACE, automatically_declare_parameters_from_overrides=True
        )
        self._parameters = declare(self, GeneratorParameters)
        self._run = 0
        self._id = 0
        self._waiting: dict[int, Future] = {}
        self._wall_clock = Clock(clock_type=ClockType.SYSTEM_TIME)
        self._publisher = self.create_publisher(Excitation, topics.EXCITATION, LATCHED)
        self._status_subscription = self.create_subscription(
            ExcitationStatus, topics.EXCITATION_STATUS, self._on_status, LATCHED
        )
        self._state_subscription = self.create_subscription(
            SimulatorState, topics.SIMULATOR_STATE, self._on_simulator_state, LATCHED
        )
        # A service that awaits the controller's answer must not keep the answer's own callback from running.
        concurrent = ReentrantCallbackGroup()
        self.create_service(StartExcitation, "~/start", self._on_start, callback_group=concurrent)
        self.create_service(StopExcitation, "~/stop", self._on_stop, callback_group=concurrent)

    async def _on_start(
        self, request: StartExcitation.Request, response: StartExcitation.Response
    ) -> StartExcitation.Response:
        try:
            settings = excitation_from_request(request.kind, {name: getattr(request, name) for name in REQUEST_FIELDS})
            signal = generate(settings, self._parameters.sample_rate)
            if request.first_step < Excitation.FROM_NEXT_STEP:
                raise ExcitationError(
                    f"first_step = {request.first_step} is not allowed; allowed: 0 or more, or "
                    f"{Excitation.FROM_NEXT_STEP} for the next step"
                )
            message = self._message(signal, settings.model_dump(), request.run or self._run, request.first_step)
            status = await self._publish(message)
        except AmbError as problem:
            response.message = str(problem)
            return response
        response.success = status.accepted
        response.message = status.message
        response.run = status.run
        response.first_step = status.first_step
        response.steps = status.steps
        return response

    async def _on_stop(
        self, _request: StopExcitation.Request, response: StopExcitation.Response
    ) -> StopExcitation.Response:
        message = Excitation(
            run=self._run, kind="stop", first_step=Excitation.FROM_NEXT_STEP, sample_time=1.0 / self._parameters.sample_rate
        )
        try:
            status = await self._publish(message)
        except AmbError as problem:
            response.message = str(problem)
            return response
        response.success = status.accepted
        response.message = status.message
        return response

    def _message(self, signal: ExcitationSignal, settings: dict[str, object], run: int, first_step: int) -> Excitation:
        return Excitation(
            run=run,
            kind=signal.kind,
            description=json.dumps(settings),
            first_step=first_step,
            sample_time=signal.sample_time,
            reference_x=array("d", signal.samples[:, 0].tobytes()),
            reference_y=array("d", signal.samples[:, 1].tobytes()),
            frequency=array("d", b"" if signal.frequency is None else signal.frequency.tobytes()),
        )

    async def _publish(self, message: Excitation) -> ExcitationStatus:
        """Publish an excitation and return the controller's answer.

        Raises
        ------
        ExcitationError
            If no controller answers in time.
        """
        self._id += 1
        message.id = self._id
        message.header.stamp = self._wall_clock.now().to_msg()
        answer = self._waiting[self._id] = Future()
        timeout = self._parameters.answer_timeout
        timer = self.create_timer(
            timeout, lambda: answer.done() or answer.set_result(None), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._publisher.publish(message)
        try:
            status = await answer
        finally:
            del self._waiting[message.id]
            self.destroy_timer(timer)
        if status is None:
            raise ExcitationError(
                f"no answer within {timeout:g} s from a controller on {self._publisher.topic_name} "
                f"({self._publisher.get_subscription_count()} listening); is pd_controller running?"
            )
        if status.accepted and message.first_step != status.first_step:
            # For controllers and recorders that join later: the same excitation with its step resolved.
            message.first_step = status.first_step
            self._publisher.publish(message)
        return status

    def _on_status(self, message: ExcitationStatus) -> None:
        answer = self._waiting.get(message.id)
        if answer is not None and not answer.done():
            answer.set_result(message)

    def _on_simulator_state(self, message: SimulatorState) -> None:
        self._run = message.run


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM."""
    return run_node(ExcitationGeneratorNode, args, SingleThreadedExecutor)


if __name__ == "__main__":
    raise SystemExit(main())
