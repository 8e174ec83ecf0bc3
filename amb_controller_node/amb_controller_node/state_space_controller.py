"""Node `state_space_controller`: any discrete linear controller of all axes, from a file or from a topic.

It takes the place of `pd_controller`: same topics, same telemetry, same excitations.
"""

from __future__ import annotations

from amb_controller_node.controller_node import ControllerNode
from amb_controller_node.parameters import StateSpaceControllerParameters
from amb_core.ground.errors import AmbError, ParameterError, one_line
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.linear_control import LinearController, pd_as_linear, with_anti_windup
from amb_core.loop.linear_parameters import require_order
from amb_core.loop.machine import Machine
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.recording.messages.state_space_model import model_from_message
from amb_msgs.msg import StateSpaceModel as StateSpaceModelMessage
from amb_ros import topics
from amb_ros.process import run_node
from amb_ros.qos import LATCHED
from amb_ros.subscriptions import create_subscription


class StateSpaceControllerNode(ControllerNode):
    """The controller. Topics and parameters: see the package's README."""

    def __init__(self) -> None:
        self._controller: StateSpaceModel | None = None
        _compile()
        super().__init__("state_space_controller", StateSpaceControllerParameters)
        file = self._settings.controller_file
        if file:
            try:
                self._controller = with_anti_windup(StateSpaceModel.load(file))
            except AmbError as problem:
                raise ParameterError(f"{self.get_fully_qualified_name()}: controller_file: {problem}") from None
        self._controller_subscription = create_subscription(
            self, StateSpaceModelMessage, topics.CONTROLLER, self._on_controller, LATCHED
        )

    def law_for(self, machine: Machine, parameters: StateSpaceControllerParameters) -> LinearController:
        """The linear law, if it fits the machine."""
        if self._controller is None:
            topic = self._controller_subscription.topic_name
            raise ParameterError(f"no controller yet; give its file as controller_file, or publish it on {topic}")
        require_order(self._controller, [axis.name for axis in machine.axes])
        return LinearController(self._controller, parameters, len(machine.axes), machine.sample_rate)

    def configure(self, law: LinearController, parameters: StateSpaceControllerParameters) -> None:
        """Use a changed limit or nominal reference."""
        law.configure(parameters)

    def _on_controller(self, message: StateSpaceModelMessage) -> None:
        """Take another controller, from the next run on; one that cannot be used leaves the present one."""
        try:
            self._controller = with_anti_windup(model_from_message(message))
        except AmbError as problem:
            topic = self._controller_subscription.topic_name
            self.get_logger().error(f"controller of {topic} refused: {one_line(problem)}")
            return
        self.renew_law()


def _compile() -> None:
    """Compile the law before the first position arrives."""
    parameters = ControllerParameters()
    law = LinearController(pd_as_linear(parameters), StateSpaceControllerParameters(), 2, parameters.sample_rate)
    law.update((0.0, 0.0), (0.0, 0.0))


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP."""
    return run_node(StateSpaceControllerNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
